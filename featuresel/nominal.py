"""The renderer that routines prepare with: a look as it is planned to be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from featuresel.case import (
    LookCase,
    moved_layers,
    picture,
    still_layers,
    still_lights,
)
from featuresel.disturb import turned
from featuresel.routines import Blur, Camera, Drifts, Sway, Veil
from featuresel.standing import CUT, Backdrop, standing, usual_range
from optics.microscope import Microscope
from optics.outline import Outline, Ring, Segment, place
from optics.prepared import prepare
from optics.scene import Illumination, Layer, Scene, Window
from optics.views import Range

FloatArray = npt.NDArray[np.float64]

_POINT = 1e-12  # fill factor of samples that integrate over no area
_VEILED = 3.0  # fields: the face behind what stands in front ends out of sight
_HELD_PX = 1 << 22  # of images that are kept, 32 MiB: routines ask for the same ones
_BACKDROPS = 4  # settings whose still layers are kept
_TURNS = 12  # of the circle, where an angle is unknown: blur leaves its first waves

Asked = tuple[float, ...]  # numbers that an image depends on
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Known:
    """What was made before, what was asked for last at the end."""

    images: dict[Asked, FloatArray] = field(default_factory=dict)
    backdrops: dict[Asked, Backdrop] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class NominalRender:
    """Renders a case's region, at nominal focus and zoom unless told else."""

    case: LookCase
    known: _Known = field(default_factory=_Known, init=False, compare=False, repr=False)

    @property
    def camera(self) -> Camera:
        """Return the camera's noise."""
        sensor = self.case.sensor
        return Camera(
            full_well_e=sensor.full_well_e,
            read_noise_e=sensor.read_noise_e,
            bits=sensor.bits,
            fill_factor=self.case.microscope.fill_factor,
        )

    @property
    def blur(self) -> Blur:
        """Return what the optics can show."""
        scope = self.case.microscope
        return Blur(
            cutoff_per_um=scope.cutoff_per_um,
            depth_um=scope.wave_depth_um,
            cone=scope.blur_diameter_um(1.0) / 2,
        )

    @property
    def drifts(self) -> Drifts:
        """Return what else the trials of this look vary."""
        spread = self.case.spread
        return Drifts(
            focus_sigma_um=spread.focus_sigma_um,
            zoom_sigma=spread.magnification_sigma,
            gradient=spread.light_gradient[1],
            axis_px=self.case.frame.to_pixel(0.0, 0.0),
        )

    def __call__(
        self,
        *,
        dx_um: float = 0.0,
        dy_um: float = 0.0,
        theta_rad: float = 0.0,
        dz_um: float = 0.0,
        zoom: float = 1.0,
    ) -> FloatArray:
        """Return the noise-free region, clipped to what the sensor can tell, 0..1.

        `theta_rad` is the turn away from the nominal angle. Images that were asked for
        not long ago are given again.
        """

        def made() -> FloatArray:
            found = self._picture((dx_um, dy_um, theta_rad), dz_um=dz_um, zoom=zoom)
            return np.clip(found, 0.0, 1.0)

        asked, window = (dx_um, dy_um, theta_rad, dz_um, zoom), self.case.window
        most = _HELD_PX // (window.rows * window.columns)
        return _held(self.known.images, asked, most, made).copy()

    def at_height(
        self, dz_um: float, *, dx_um: float, dy_um: float, theta_rad: float
    ) -> FloatArray:
        """Return the same image, of a pose that is asked for at several heights."""
        found = self._picture(
            (dx_um, dy_um, theta_rad), dz_um=dz_um, zoom=1.0, again=True
        )
        return np.clip(found, 0.0, 1.0)

    def template(
        self, dz_um: Sequence[float], *, over: int, half_px: tuple[int, int]
    ) -> FloatArray:
        """Return the target alone at points, see `featuresel.routines.LookModel`.

        Raises
        ------
        ValueError
            If `over` is even: no sample would be at a pixel's centre.
        """
        if over < 1 or over % 2 == 0:
            raise ValueError(f"over must be odd and positive, got {over}")
        fine = _fine(self.case, over, half_px)
        moved = moved_layers(fine, 0.0, 0.0, 0.0)
        if fine.shares_spectra:
            return _through_focus(fine, moved, dz_um)
        return np.stack([_alone(fine, moved, dz) for dz in dz_um])

    def alone(
        self, *, dx_um: float = 0.0, dy_um: float = 0.0, dz_um: float = 0.0
    ) -> FloatArray:
        """Return the region without what stands still, not clipped.

        The light's gradient is left out: it belongs to the frame, not to the target.
        """
        even = Illumination(gain=self.case.light.gain)
        lone = NominalRender(case=replace(self.case, static=(), light=even))
        return lone._picture((dx_um, dy_um, 0.0), dz_um=dz_um, zoom=1.0)

    def veil(self, dz_um: float = 0.0) -> Veil:
        """Return what stands in front of the target, `dz_um` off nominal focus.

        A face without end at the height of the target's top, once black and once white,
        takes the target's place; what lies below it is not seen.
        """
        rows, columns = self.case.window.rows, self.case.window.columns
        top_um = max(layer.z_um for layer in self.case.moving)
        if all(layer.z_um <= top_um for layer in self.case.static):
            return Veil(
                light=np.zeros((rows, columns)), through=np.ones((rows, columns))
            )
        focus_um = self.case.focus_um + dz_um
        # what lies below the face is hidden, and need not be rendered
        hidden = tuple(layer for layer in self.case.static if layer.z_um > top_um)
        even = replace(
            self.case, light=Illumination(), static=hidden, background_z_um=None
        )
        shown = _before(even, _face(even, top_um, 0.0), dz_um)
        even = replace(even, focus_um=focus_um)
        black, white = (
            _faced(even, _face(even, top_um, share), shown) for share in (0.0, 1.0)
        )
        return Veil(light=self.case.light.gain * black, through=white - black)

    def sways(self) -> tuple[Sway, ...]:
        """Return how the image may differ as what stands still may lie elsewhere.

        Each owner for itself: to both sides along x and y by the spread that trials
        have, and round the circle or to both sides where its angle is unknown.
        """
        image, through = self(), self.veil().through
        found = [(nominal_render(case), root) for case, root in _elsewhere(self.case)]
        return tuple(
            Sway(
                shown=root * (there() - image),
                through=root * (there.veil().through - through),
            )
            for there, root in found
        )

    def _picture(
        self,
        moved: tuple[float, float, float],
        *,
        dz_um: float,
        zoom: float,
        again: bool = False,
    ) -> FloatArray:
        """Return the region with the target moved by (um, um, rad), not clipped.

        The target is transformed once for all places at its own angle, and for all
        heights of a pose that is asked for `again`.
        """
        case, reach = self.case, usual_range(self.case)
        scope = replace(
            case.microscope, magnification=case.microscope.magnification * zoom
        )
        focus_um, layers = case.focus_um + dz_um, moved_layers(case, *moved)
        shown = _held(
            self.known.backdrops,
            (dz_um, zoom),
            _BACKDROPS,
            lambda: _backdrop(case, scope, focus_um, zoom),
        )
        x, y, turn = moved
        if (again or turn == 0) and reach.holds(focus_um, (x, y), zoom):
            at, by_um = (moved, (0.0, 0.0)) if again else ((0.0, 0.0, 0.0), (x, y))
            ready = standing(case, moved_layers(case, *at), reach, case.model)
            if ready is not None:
                own = ready.at(focus_um=focus_um, zoom=zoom, shift_um=by_um)
                shown, layers = shown.with_(own), ()
        return picture(
            case,
            layers,
            scope,
            focus_um=focus_um,
            model=case.model,
            light=case.light,
            backdrop=shown.layers,
            under=shown.under,
        )


def nominal_render(case: LookCase) -> NominalRender:
    """Return the renderer that routines prepare with."""
    return NominalRender(case=case)


def swayed(case: LookCase) -> FloatArray:
    """Return what the image of a look changes by as what stands still lies elsewhere.

    Returns
    -------
    (C, rows, columns) float64 array
        Shares of full scale, as `NominalRender.sways` shows them.
    """
    image = nominal_render(case)()
    changes = [root * (nominal_render(c)() - image) for c, root in _elsewhere(case)]
    return np.array(changes).reshape(-1, *image.shape)


def _elsewhere(case: LookCase) -> Iterator[tuple[LookCase, float]]:
    """Yield the look with what stands still elsewhere, and the root of its weight."""
    own = case.target.name.partition(".")[0]
    names = sorted({layer.name.partition(".")[0] for layer in case.static} - {own})
    sigma = case.spread.occluder_sigma_um
    for name in names if sigma > 0 else ():
        for x, y in ((sigma, 0.0), (-sigma, 0.0), (0.0, sigma), (0.0, -sigma)):
            moved = _moved(case.static, name, x, y)
            yield replace(case, static=moved), math.sqrt(1 / 2)
    for what in case.spread.turning:
        turns = [what.sigma_theta_rad, -what.sigma_theta_rad]
        if what.is_any:
            turns = [2 * math.pi * k / _TURNS for k in range(1, _TURNS)]
        for turn in turns:
            weight = 1 / (_TURNS if what.is_any else 2)
            there = turned(case.static, what, turn)
            yield replace(case, static=there), math.sqrt(weight)


def _moved(
    layers: tuple[Layer, ...], owner: str, x_um: float, y_um: float
) -> tuple[Layer, ...]:
    """Return layers with those of one owner moved."""
    return tuple(
        replace(layer, outline=place(layer.outline, x_um, y_um, 0.0))
        if layer.name.partition(".")[0] == owner
        else layer
        for layer in layers
    )


def _backdrop(
    case: LookCase, scope: Microscope, focus_um: float, zoom: float
) -> Backdrop:
    """Return what stands still in a look at some focus and zoom."""
    reach = usual_range(case)
    if reach.holds(focus_um, (0.0, 0.0), zoom):
        ready = standing(case, case.static, reach, case.model)
        if ready is not None:
            return ready.at(focus_um=focus_um, zoom=zoom)
    return Backdrop(
        still_layers(case, scope, focus_um=focus_um, model=case.model),
        still_lights(case, scope, focus_um=focus_um),
    )


def _held(known: dict[Asked, T], asked: Asked, most: int, make: Callable[[], T]) -> T:
    """Return what is known or made now; the `most` asked for last stay, or one."""
    found = known.pop(asked) if asked in known else make()
    while known and len(known) >= most:
        del known[next(iter(known))]
    known[asked] = found
    return found


def _fine(case: LookCase, over: int, half_px: tuple[int, int]) -> LookCase:
    """Return the target alone in a window of finer pixels about its nominal place."""
    scope: Microscope = replace(
        case.microscope,
        pitch_um=case.microscope.pitch_um / over,
        width_px=case.microscope.width_px * over,
        height_px=case.microscope.height_px * over,
        fill_factor=_POINT,
    )
    column = case.window.column + round(case.target.column)
    row = case.window.row + round(case.target.row)
    middle = (over - 1) // 2
    window = Window(
        row=(row - half_px[1]) * over + middle,
        column=(column - half_px[0]) * over + middle,
        rows=2 * half_px[1] * over + 1,
        columns=2 * half_px[0] * over + 1,
    )
    # the light's gradient belongs to the frame, not to the target
    even = Illumination(gain=case.light.gain)
    return replace(case, static=(), microscope=scope, window=window, light=even)


def _alone(fine: LookCase, moved: tuple[Layer, ...], dz_um: float) -> FloatArray:
    """Return the picture of the target alone at one focus."""
    return picture(
        fine,
        moved,
        fine.microscope,
        focus_um=fine.focus_um + dz_um,
        model=fine.model,
        light=fine.light,
    )


def _through_focus(
    fine: LookCase, moved: tuple[Layer, ...], dz_um: Sequence[float]
) -> FloatArray:
    """Return the pictures of the target alone from spectra computed once."""
    heights = [fine.focus_um + dz for dz in dz_um]
    ready = prepare(
        Scene(layers=moved, background=fine.background),
        fine.microscope,
        Range(focus_um=(min(heights), max(heights))),
        model=fine.model,
        window=fine.window,
        sampling=fine.sampling,
    )
    return np.stack([ready.image(focus_um=z, light=fine.light) for z in heights])


def _before(case: LookCase, face: Layer, dz_um: float) -> Backdrop:
    """Return what stands before a face, `dz_um` off nominal focus.

    Heights within one of equal steps share the transforms.
    """
    wide_um = max(2 * CUT * case.spread.focus_sigma_um, case.microscope.wave_depth_um)
    middle_um = case.focus_um + round(dz_um / wide_um) * wide_um
    half_um = wide_um / 2 * (1 + 1e-9)  # ends belong to both
    reach = Range(focus_um=(middle_um - half_um, middle_um + half_um))
    ready = standing(replace(case, moving=(face,)), case.static, reach, case.model)
    return Backdrop() if ready is None else ready.at(focus_um=case.focus_um + dz_um)


def _faced(case: LookCase, face: Layer, shown: Backdrop) -> FloatArray:
    """Return the region with a face in the target's place."""
    return picture(
        case,
        (face,),
        case.microscope,
        focus_um=case.focus_um,
        model=case.model,
        light=case.light,
        backdrop=shown.layers,
        under=shown.under,
    )


def _face(case: LookCase, z_um: float, reflectance: float) -> Layer:
    """Return a face without end."""
    side = _VEILED * max(case.microscope.field_um)
    corners = [(-side, -side), (side, -side), (side, side), (-side, side)]
    edges = tuple(
        Segment(start=a, end=b)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    )
    return Layer(
        name="face",
        outline=Outline(rings=(Ring(edges=edges),)),
        z_um=z_um,
        reflectance=reflectance,
    )
