"""The renderer that routines prepare with: a look as it is planned to be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.camera_noise import camera_noise
from microplan.featuresel.look.discrepancy import contrast
from microplan.featuresel.look.edge_lines import line_images
from microplan.featuresel.look.occluders import displaced_look, occluders
from microplan.featuresel.look.scenario import (
    Backdrop,
    LookCase,
    moved_layers,
    render_look,
)
from microplan.featuresel.look.static_layers import fresh, standing, usual_range
from microplan.featuresel.look.surface_changes import surface_changes
from microplan.featuresel.look.templates import template
from microplan.featuresel.routines.contract import (
    Blur,
    CameraNoise,
    Nuisances,
    OccluderMode,
    Occluders,
    SurfaceChange,
)
from microplan.optics.render.scene import Illumination

_HELD_PX = 1 << 22  # of images that are kept, 32 MiB: routines ask for the same ones
_BACKDROPS = 4  # settings whose still layers are kept

Asked = tuple[float, ...]  # numbers that an image depends on
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Known:
    """What was made before, what was asked for last at the end."""

    images: dict[Asked, FloatArray] = field(default_factory=dict)
    backdrops: dict[Asked, Backdrop] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class NominalRender:
    """Renders a case's region, at nominal focus and zoom unless stated otherwise."""

    case: LookCase
    known: _Known = field(default_factory=_Known, init=False, compare=False, repr=False)

    @property
    def camera(self) -> CameraNoise:
        """Return the camera's noise, and how far its pixels are from any model."""
        sensor, own = replace(self.case.sensor, gain=1.0), self.case.discrepancy
        noise = camera_noise(sensor, self.case.microscope.fill_factor)
        return noise if own is None else replace(noise, misfit=own.pixel)

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
    def nuisances(self) -> Nuisances:
        """Return what else the trials of this look vary."""
        spread = self.case.spread
        return Nuisances(
            focus_sigma_um=spread.focus_sigma_um,
            zoom_sigma=spread.magnification_sigma,
            gradient=spread.light_gradient[1],
            axis_px=self.case.frame.to_pixel(0.0, 0.0),
            has_lines=self.case.ring is not None,
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

        `theta_rad` is the rotation away from the nominal angle. Images that were asked
        for not long ago are given again.
        """

        def made() -> FloatArray:
            found = self._picture((dx_um, dy_um, theta_rad), dz_um=dz_um, zoom=zoom)
            return np.clip(found, 0.0, 1.0)

        asked, window = (dx_um, dy_um, theta_rad, dz_um, zoom), self.case.window
        most = _HELD_PX // (window.rows * window.columns)
        return _held(self.known.images, asked, most, made).copy()

    def template(
        self, dz_um: Sequence[float], *, over: int, half_px: tuple[int, int]
    ) -> FloatArray:
        """Return the target alone, (K, 2 R + 1, 2 C + 1) samples: see `template`."""
        return template(self.case, dz_um, over=over, half_px=half_px)

    def alone(
        self, *, dx_um: float = 0.0, dy_um: float = 0.0, dz_um: float = 0.0
    ) -> FloatArray:
        """Return the region without the static scene, (rows, columns), full scale 1.

        It is not clipped.

        The light's gradient is left out: it belongs to the frame, not to the target.
        """
        even = Illumination(gain=self.case.light.gain)
        lone = NominalRender(case=replace(self.case, static=(), light=even))
        return lone._picture((dx_um, dy_um, 0.0), dz_um=dz_um, zoom=1.0)

    def occluders(self, dz_um: float = 0.0) -> Occluders:
        """Return the occluders: see `look.occluders.occluders`."""
        return occluders(self.case, dz_um)

    def occluder_modes(self) -> tuple[OccluderMode, ...]:
        """Return the image changes by likely displacements of the static scene.

        Each owner for itself: to both sides along x and y by the standard deviation
        that trials have, and round the circle or to both sides where its angle is
        unknown.
        """
        image, through = self(), self.occluders().through
        found = [
            (nominal_render(case), root) for case, root in displaced_look(self.case)
        ]
        return tuple(
            OccluderMode(
                shown=root * (there() - image),
                through=root * (there.occluders().through - through),
            )
            for there, root in found
        )

    def surface_changes(self) -> tuple[SurfaceChange, ...]:
        """Return the changes by surfaces that are not known: see `surface_changes`."""
        return surface_changes(self.case, nominal_render)

    def line_images(self) -> tuple[FloatArray, ...]:
        """Return the image with other lines of rounded edges: see `line_images`."""
        return line_images(self.case, nominal_render)

    def _picture(
        self, moved: tuple[float, float, float], *, dz_um: float, zoom: float
    ) -> FloatArray:
        """Return the region with the target moved by (um, um, rad), not clipped.

        The target is transformed once for all positions at its own angle.
        """
        case, focus_um = self.case, self.case.focus_um + dz_um
        seen = replace(case, microscope=case.zoomed(zoom), focus_um=focus_um)
        shown = _held(
            self.known.backdrops,
            (dz_um, zoom),
            _BACKDROPS,
            lambda: _backdrop(case, seen, zoom),
        )
        layers = moved_layers(case, *moved)
        own = self._own(moved, focus_um=focus_um, zoom=zoom)
        if own is not None:
            shown, layers = shown.with_(own), ()
        return render_look(seen, layers, shown)

    def _own(
        self, moved: tuple[float, float, float], *, focus_um: float, zoom: float
    ) -> Backdrop | None:
        """Return the target from what was transformed once, None where that is not."""
        case, reach = self.case, usual_range(self.case)
        x, y, turn = moved
        if turn != 0 or not reach.holds(focus_um, (x, y), zoom):
            return None
        ready = standing(case, moved_layers(case, 0.0, 0.0, 0.0), reach, case.model)
        if ready is None:
            return None
        return ready.at(focus_um=focus_um, zoom=zoom, shift_um=(x, y))


def nominal_render(case: LookCase) -> NominalRender:
    """Return the renderer that routines prepare with."""
    return NominalRender(case=case)


def target_contrast(case: LookCase) -> float:
    """Return the usual step of light at a look's target, as `contrast` does."""
    reach_px = case.reach_um * case.target.px_per_um
    return contrast(nominal_render(case)(), case.target, reach_px)


def displacement_changes(case: LookCase) -> FloatArray:
    """Return the changes of a look's image by likely displacements of static bodies.

    Returns
    -------
    (C, rows, columns) float64 array
        Shares of full scale, as `NominalRender.occluder_modes` shows them.
    """
    image = nominal_render(case)()
    changes = [root * (nominal_render(c)() - image) for c, root in displaced_look(case)]
    return np.array(changes).reshape(-1, *image.shape)


def _backdrop(case: LookCase, seen: LookCase, zoom: float) -> Backdrop:
    """Return the static scene in a look `seen` at some focus and zoom."""
    reach = usual_range(case)
    if reach.holds(seen.focus_um, (0.0, 0.0), zoom):
        ready = standing(case, case.static, reach, case.model)
        if ready is not None:
            return ready.at(focus_um=seen.focus_um, zoom=zoom)
    return fresh(seen, seen.static)


def _held(known: dict[Asked, T], asked: Asked, most: int, make: Callable[[], T]) -> T:
    """Return what is known or made now; the `most` asked for last stay, or one."""
    found = known.pop(asked) if asked in known else make()
    while known and len(known) >= most:
        del known[next(iter(known))]
    known[asked] = found
    return found
