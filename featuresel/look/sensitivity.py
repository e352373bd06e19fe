"""How the mean image of a look changes with pose, focus, zoom and light."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import (
    Backdrop,
    LookCase,
    moved_layers,
    render_look,
)
from microplan.featuresel.look.static_layers import Standing, standing
from microplan.optics.outline.outline import Outline
from microplan.optics.render.layer_blending import light_up
from microplan.optics.render.scene import Illumination, Layer
from microplan.optics.render.view_range import Range

POSE = ("x", "y", "theta", "z", "zoom")  # um, um, rad, um of the focus, over nominal
# of the nominal light; change across the field, twice; share of full scale
LIGHT = ("gain", "gradient_x", "gradient_y", "offset")

# Differences multiply what the renderer errs by, so band and margin are wider than an
# image needs: slopes err by 1e-3 of their norm at most, and where several bodies hide
# the same rays by 1e-2, those to z by 5e-2 (tested).
_BAND_ERROR = 1e-5
_MARGIN = 160.0
_STEP = 0.035  # of wavelength / A, the resolution: how far an edge moves
_STEP_Z = 0.03  # of n wavelength / A**2, the depth of field
_LARGEST_TURN = 0.02  # rad, where a target is smaller than its blur
_LARGEST_ZOOM = 0.01
_FARTHEST = 4  # steps from the middle of a difference
_MORE = 1 + 1e-6  # times that, for what rounding adds


@dataclass(frozen=True, slots=True, kw_only=True)
class LookSetting:
    """Where a look stands: displacements from nominal, and light times nominal."""

    dx_um: float = 0.0
    dy_um: float = 0.0
    dtheta_rad: float = 0.0
    dz_um: float = 0.0  # of the focus
    zoom: float = 1.0  # over nominal
    gain: float = 1.0  # times the nominal light
    gradient_x: float = 0.0  # added to the nominal light's
    gradient_y: float = 0.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite, got {getattr(self, name)}")
        if not self.zoom > 0 or not self.gain >= 0:
            raise ValueError(
                f"zoom must be positive and gain not negative, got {self.zoom}, "
                f"{self.gain}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivities:
    """A mean image and its slopes, in shares of the top count."""

    names: tuple[str, ...]  # of `POSE` and `LIGHT`
    mean: FloatArray  # (rows, columns), not clipped
    slopes: FloatArray  # (P, rows, columns) per um, rad or 1
    errors: FloatArray  # (P, rows, columns) what a slope may err by, >= 0
    ceiling: float = 1.0  # where the well is full

    def __post_init__(self) -> None:
        shape = (len(self.names), *self.mean.shape)
        if self.mean.ndim != 2 or self.slopes.shape != shape:
            raise ValueError(f"slopes must be {shape}, got {self.slopes.shape}")
        if self.errors.shape != shape or len(set(self.names)) < len(self.names):
            raise ValueError(f"one error a slope and one slope a name: {self.names}")
        arrays = (self.mean, self.slopes, self.errors)
        if not all(np.isfinite(array).all() for array in arrays):
            raise ValueError("mean, slopes and errors must be finite")


def sensitivities(
    case: LookCase,
    setting: LookSetting | None = None,
    names: Sequence[str] = POSE + LIGHT[:3],
) -> Sensitivities:
    """Return the mean image of a look and how it changes.

    Parameters
    ----------
    case : LookCase
        The look; its defocus model, shade and lens are those of the images.
    setting : Setting, optional
        Where the look stands. Default: as planned.
    names : sequence of str
        Of `POSE` and `LIGHT`. `x`, `y` and `theta` move the target alone, `z` raises
        the plane in focus, `zoom` scales the image about the optical axis.

    Returns
    -------
    Sensitivities
        Slopes to pose, focus and zoom by central differences with one Richardson
        extrapolation, (4 D(h) - D(2 h)) / 3; `errors` are what it changes by from 2 h
        to h, 15 times the error that the series leaves and half the renderer's own.
        Slopes to light in closed form, without error.

    Raises
    ------
    ValueError
        If a name is unknown, or the renderer refuses the case.
    """
    unknown = [name for name in names if name not in POSE + LIGHT]
    if unknown:
        raise ValueError(f"no such parameters: {unknown}, known: {POSE + LIGHT}")
    at = setting or LookSetting()
    steps = {name: h for name, h in _steps(case, at).items() if name in names}
    look = _FocusRenderer.of(case, at, steps)
    unlit, light = look.unlit(), _light(case, at)
    mean = unlit * light
    slopes = np.zeros((len(names), *unlit.shape))
    errors = np.zeros_like(slopes)
    for k, name in enumerate(names):
        if name in LIGHT:
            slopes[k] = _to_light(case, at, unlit, name)
        else:
            slope, error = _difference(look.along(name), steps[name])
            slopes[k], errors[k] = slope * light, error * light
    gain = case.sensor.gain
    return Sensitivities(
        names=tuple(names),
        mean=mean * gain,
        slopes=slopes * gain,
        errors=errors * gain,
        ceiling=min(1.0, gain),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _FocusRenderer:
    """Renders a case in even light, about a setting; through focus from one spectrum.

    `case` is at the setting's zoom; so are the zooms of views.
    """

    case: LookCase
    at: LookSetting
    still: Standing | None  # None, both: images do not share layers
    own: Standing | None  # the target in its position
    behind: Backdrop  # the static scene, at the setting's focus and zoom

    @classmethod
    def of(
        cls, case: LookCase, at: LookSetting, steps: Mapping[str, float]
    ) -> _FocusRenderer:
        """Return the look, with band and margin wide enough for differences."""
        sampling = replace(
            case.sampling,
            band_error=min(case.sampling.band_error, _BAND_ERROR),
            margin=max(case.sampling.margin, _MARGIN),
            single=False,
        )
        fine = replace(case, sampling=sampling, microscope=case.zoomed(at.zoom))
        focus_um = case.focus_um + at.dz_um
        far_um, ratio = (_FARTHEST * steps.get(name, 0.0) for name in ("z", "zoom"))
        ratio *= _MORE / at.zoom
        reach = Range(
            focus_um=(focus_um - _MORE * far_um, focus_um + _MORE * far_um),
            zoom=(1 - ratio, 1 + ratio),
        )
        moved = moved_layers(fine, at.dx_um, at.dy_um, at.dtheta_rad)
        still, own = (
            standing(fine, layers, reach, fine.model, keep=False)
            for layers in (fine.static, moved)
        )
        behind = still.at(focus_um=focus_um) if still else Backdrop()
        return cls(case=fine, at=at, still=still, own=own, behind=behind)

    def along(self, name: str) -> Callable[[float], FloatArray]:
        """Return what renders the look a step of one parameter away."""
        field = {"zoom": "zoom", "theta": "dtheta_rad"}.get(name, f"d{name}_um")

        def stepped(step: float) -> FloatArray:
            value = getattr(self.at, field) + step
            return self.unlit(replace(self.at, **{field: value}))

        return stepped

    def unlit(self, at: LookSetting | None = None) -> FloatArray:
        """Return the region in even light of gain 1, (rows, columns)."""
        at = at or self.at
        zoom = at.zoom / self.at.zoom
        layers, shown = self._seen(at, zoom)
        seen = replace(
            self.case,
            microscope=self.case.zoomed(zoom),
            focus_um=self.case.focus_um + at.dz_um,
            light=Illumination(),
        )
        return render_look(seen, layers, shown)

    def _seen(self, at: LookSetting, zoom: float) -> tuple[tuple[Layer, ...], Backdrop]:
        """Return the layers to be rendered anew, and those that are ready.

        What is displaced on its tile would be cut off elsewhere: an edge that goes on
        beyond it would seem to tell where along itself it lies.
        """
        pose, mine = (at.dx_um, at.dy_um, at.dtheta_rad), self.at
        in_place = pose == (mine.dx_um, mine.dy_um, mine.dtheta_rad)
        if self.still is None or self.own is None or not in_place:
            # one parameter alone is a step off: focus and zoom are the setting's
            return moved_layers(self.case, *pose), self.behind
        focus_um = self.case.focus_um + at.dz_um
        behind = self.still.at(focus_um=focus_um, zoom=zoom)
        return (), behind.with_(self.own.at(focus_um=focus_um, zoom=zoom))


def _light(case: LookCase, at: LookSetting) -> FloatArray:
    """Return the light's intensity at the pixels, (rows, columns)."""
    light = np.ones((case.window.rows, case.window.columns))
    shining = case.lit(at.gain, at.gradient_x, at.gradient_y)
    light_up(light, case.microscope, case.window, shining)
    return light


def _to_light(
    case: LookCase, at: LookSetting, unlit: FloatArray, name: str
) -> FloatArray:
    """Return the slope of the mean to one parameter of the light."""
    if name == "offset":
        return np.ones_like(unlit)
    if name == "gain":
        return unlit * _light(case, replace(at, gain=1.0))
    even = replace(case, light=Illumination(gain=case.light.gain))
    flat = replace(at, gradient_x=0.0, gradient_y=0.0)
    tilted = replace(flat, **{name: 1.0})
    return unlit * (_light(even, tilted) - _light(even, flat))


def _difference(
    image: Callable[[float], FloatArray], step: float
) -> tuple[FloatArray, FloatArray]:
    """Return a slope at 0, and what it may err by."""
    near, middle, far = (
        (image(h) - image(-h)) / (2 * h) for h in (step, 2 * step, _FARTHEST * step)
    )
    slope = (4 * near - middle) / 3
    return slope, np.abs(slope - (4 * middle - far) / 3)


def _steps(case: LookCase, at: LookSetting) -> dict[str, float]:
    """Return the smallest step of each parameter of `POSE`.

    A rotation and a zoom move the farthest edge as far as a shift does.
    """
    scope = case.microscope
    shift = _STEP * scope.wavelength_um / scope.aperture
    reach = max((_reach_um(layer.outline) for layer in case.moving), default=0.0)
    farthest = _farthest_um(case)
    return {
        "x": shift,
        "y": shift,
        "theta": min(shift / reach, _LARGEST_TURN) if reach else _LARGEST_TURN,
        "z": _STEP_Z * scope.wave_depth_um,
        "zoom": min(shift / farthest, _LARGEST_ZOOM) * at.zoom,
    }


def _reach_um(outline: Outline) -> float:
    """Return the distance of the farthest corner of a box about an outline."""
    if not outline.rings:
        return 0.0
    left, low, right, high = outline.bounds_um
    return math.hypot(max(abs(left), abs(right)), max(abs(low), abs(high)))


def _farthest_um(case: LookCase) -> float:
    """Return how far the farthest pixel of the window is from the optical axis."""
    scope, window = case.microscope, case.window
    rows = window.row - scope.height_px / 2, window.rows
    columns = window.column - scope.width_px / 2, window.columns
    away = [max(abs(first), abs(first + count)) for first, count in (rows, columns)]
    return math.hypot(*away) * scope.um_per_px
