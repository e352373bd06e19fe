"""Shaded faces in an image, blurred together with the light on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import (
    Irradiance,
    area_um,
    fine_um,
    pixel_axes_um,
)
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.rays import extent
from microplan.optics.layers.shade_and_occlusion import joint_shading_residual
from microplan.optics.render.render import Covered
from microplan.optics.render.scene import Scene, Window
from microplan.optics.transfer.microscope import Microscope

# Points of the rays' lattice: this many in the blur's radius of what hides, and of what
# is shaded, where 64 rays lie no closer; `benchmarks/optics/shading.py` measures what
# they leave.
_HIDING, _SHADED = 3, 8
_WIDEST = 300  # points aside that a ray may meet a layer: a limit to memory
_STEPS = 4  # an octave of distances between points
# a coverage this close to 0 or 1, as in `microplan.optics.layers.occlusion`
_UNIFORM = 0.005


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadedFace:
    """A height that is shaded: the light on it, and how it is seen."""

    light: Irradiance
    lattice: Lattice
    share: FloatArray  # of the light, at the points of the lattice
    blurred: FloatArray  # the same blurred, and averaged over pixels
    seen: FloatArray  # that at the pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadedView:
    """What an image depends on but its layers and their light."""

    microscope: Microscope
    focus_um: float
    model: str
    frame: Window
    shift_um: tuple[float, float]

    def face(self, light: Irradiance) -> ShadedFace:
        """Return how a height is seen that has at least one shade."""
        m, z_um = self.microscope, light.z_um - self.focus_um
        area = area_um(m, self.frame, self.shift_um, z_um)
        lattice = Lattice.over(area, light.step_um)
        share = light.on(lattice)
        blurred = blur(share, lattice.step_um, m, self.model, z_um)
        seen = self._at_pixels(blurred, lattice)
        return ShadedFace(
            light=light, lattice=lattice, share=share, blurred=blurred, seen=seen
        )

    def lit(self, covered: Covered, face: ShadedFace) -> FloatArray:
        """Return a layer blurred with the light on it, (rows, columns), 0..1.

        The blur of the product is that of each multiplied, and on the lattice what it
        differs by, if the light changes within what a pixel or the lens resolves. Of
        faces far out of focus `shading_residual` has that.
        """
        found = covered.coverage * face.seen
        step = face.lattice.step_um
        if not self._is_thin(face.light):
            return found
        inside = face.lattice.cells(covered.layer)
        z_um = face.light.z_um - self.focus_um
        both, alone = blur(
            np.stack([inside * face.share, inside]),
            step,
            self.microscope,
            self.model,
            z_um,
        )
        found += self._at_pixels(both - alone * face.blurred, face.lattice)
        return found

    def shading_residual(
        self, scene: Scene, covered: Sequence[Covered], faces: Sequence[ShadedFace]
    ) -> FloatArray:
        """Return the residual of blending shaded layers, (rows, columns).

        Share of full scale, at the pixels.
        """
        lights = [face.light for face in faces]
        traced = [each for each in lights if self._is_wide(each) or self._is_thin(each)]
        low = [light for light in traced if light.z_um < self.focus_um]
        high = [light for light in traced if light.z_um >= self.focus_um]
        seen = [c for c in covered if c.coverage.any()]
        change = np.zeros((self.frame.rows, self.frame.columns))
        for side in (low, high):
            if side:
                change += self._on_one_side(scene, seen, side)
        return change

    def _on_one_side(
        self, scene: Scene, seen: Sequence[Covered], traced: Sequence[Irradiance]
    ) -> FloatArray:
        """Return the residual of faces on one side of the focus.

        What lies near the focus hides sharply on points as far apart as the faces
        allow; finer ones are taken about its edges alone.
        """
        fine = 2 * fine_um(self.microscope)
        step = min(
            max(light.step_um, self._reach_um(light.z_um) / _SHADED) for light in traced
        )
        if step <= fine:
            return self.blending_residual(scene, seen, traced, -1.0, step)
        change = self.blending_residual(scene, seen, traced, step, step)
        near = [c for c in seen if fine < self._reach_um(c.layer.z_um) <= step]
        part = _edges([c.coverage for c in near])
        if part is None:
            return change
        cut = [replace(c, coverage=c.coverage[part]) for c in seen]
        about = replace(self, frame=self.frame.part(*part))
        change[part] = about.blending_residual(scene, cut, traced, fine, step)
        return change

    def blending_residual(
        self,
        scene: Scene,
        seen: Sequence[Covered],
        traced: Sequence[Irradiance],
        sharp_um: float,
        step_um: float,
    ) -> FloatArray:
        """Return the residual if faces blurred by `sharp_um` hide sharply.

        (rows, columns), share of full scale.
        """
        m = self.microscope
        soft = [c.layer for c in seen if self._reach_um(c.layer.z_um) > sharp_um]
        lattice = self._lattice([layer.z_um for layer in soft], traced, step_um)
        plane = None
        if scene.background_z_um is not None:
            plane = scene.background, scene.background_z_um
        found = {light.z_um: light for light in traced}
        thin = {light.z_um for light in traced if self._is_thin(light)}
        values = joint_shading_residual(
            soft, plane, found, lattice, m, focus_um=self.focus_um, known=thin
        )
        change = self._at_pixels(values, lattice)
        for each in seen:
            z_um = each.layer.z_um
            if self._reach_um(z_um) <= sharp_um and z_um > traced[-1].z_um:
                change *= 1 - each.coverage
        return change

    def _lattice(
        self, heights_um: Sequence[float], traced: Sequence[Irradiance], step_um: float
    ) -> Lattice:
        """Return points `step_um` apart, or as blurs of heights and faces allow."""
        m = self.microscope
        hiding = [self._reach_um(z_um) for z_um in heights_um]
        widest = max(*hiding, *(self._reach_um(each.z_um) for each in traced), 0.0)
        steps = [reach / _HIDING for reach in hiding]
        step = max(min(step_um, *steps, math.inf), 2 * fine_um(m), widest / _WIDEST)
        # images of nearly the same blur share their points
        step = 2.0 ** (math.floor(_STEPS * math.log2(step)) / _STEPS)
        return Lattice.over(area_um(m, self.frame, self.shift_um, 0.0), step)

    def _is_wide(self, light: Irradiance) -> bool:
        """Return whether rays from one point meet different light at a height."""
        least = max(light.step_um / 2, 2 * fine_um(self.microscope))
        return self._reach_um(light.z_um) > least

    def _is_thin(self, light: Irradiance) -> bool:
        """Return whether the light changes within what a pixel or the lens resolves."""
        return light.step_um < 2 * fine_um(self.microscope) and not self._is_wide(light)

    def _reach_um(self, z_um: float) -> float:
        """Return how far aside rays through one point of the image meet a height."""
        return self.microscope.blur_diameter_um(z_um - self.focus_um) / 2

    def _at_pixels(self, values: FloatArray, lattice: Lattice) -> FloatArray:
        x, y = pixel_axes_um(self.microscope, self.frame, self.shift_um)
        return lattice.read(values, x, y)


def _edges(coverages: Sequence[FloatArray]) -> tuple[slice, slice] | None:
    """Return the rows and columns where layers cover in part, None if they do not."""
    partly = [(c > _UNIFORM) & (c < 1 - _UNIFORM) for c in coverages]
    return extent(np.any(partly, axis=0)) if partly else None
