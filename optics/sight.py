"""How shaded faces are seen: blurred together with the light on them, at the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from optics.crossing import crossed
from optics.lamplight import Lattice, Light, area_um, blur, places_um
from optics.microscope import Microscope
from optics.render import Covered
from optics.scene import Layer, Scene, Window

FloatArray = npt.NDArray[np.float64]

# Points of the rays' lattice: this many in the blur's radius of what hides, and of what
# is shaded, where 64 rays lie no closer; `benchmarks/shading.py` tells what they leave.
_HIDING, _SHADED = 3, 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Face:
    """A height that is shaded: the light on it, and how it is seen."""

    light: Light
    lattice: Lattice
    share: FloatArray  # of the light, at the points of the lattice
    blurred: FloatArray  # the same blurred, and averaged over pixels
    seen: FloatArray  # that at the pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """What an image depends on but its layers and their light."""

    microscope: Microscope
    focus_um: float
    model: str
    frame: Window
    shift_um: tuple[float, float]

    def face(self, light: Light) -> Face:
        """Return how a height is seen that has at least one shade."""
        m, z_um = self.microscope, light.z_um - self.focus_um
        area = area_um(m, self.frame, self.shift_um, z_um)
        lattice = Lattice.over(area, light.step_um)
        share = light.on(lattice)
        blurred = blur(share, lattice.step_um, m, self.model, z_um)
        seen = self._at_pixels(blurred, lattice)
        return Face(
            light=light, lattice=lattice, share=share, blurred=blurred, seen=seen
        )

    def lit(self, covered: Covered, face: Face) -> FloatArray:
        """Return a layer blurred together with the light on it, at the pixels.

        The blur of the product is taken from that of each, and what it differs by from
        their product on the lattice, where the light changes within a pixel. Where
        the face is far out of focus, `lacking` has that.
        """
        found = covered.coverage * face.seen
        step = face.lattice.step_um
        if step >= self.microscope.um_per_px or self._is_traced(face.light):
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

    def lacking(
        self, scene: Scene, covered: Sequence[Covered], faces: Sequence[Face]
    ) -> FloatArray:
        """Return what shaded layers lack if each is blended alone, at the pixels."""
        traced = [face.light for face in faces if self._is_traced(face.light)]
        low = [light for light in traced if light.z_um < self.focus_um]
        high = [light for light in traced if light.z_um > self.focus_um]
        seen = [c for c in covered if c.coverage.any()]
        change = np.zeros((self.frame.rows, self.frame.columns))
        if low:
            change += self._crossed(scene, seen, low)
            for each in seen:
                if self._is_sharp(each.layer) and each.layer.z_um > low[-1].z_um:
                    change *= 1 - each.coverage
        if high:
            change += self._crossed(replace(scene, background_z_um=None), seen, high)
        return change

    def _crossed(
        self, scene: Scene, seen: Sequence[Covered], traced: Sequence[Light]
    ) -> FloatArray:
        """Return what faces on one side of the focus lack."""
        m = self.microscope
        layers = [c.layer for c in seen if not self._is_sharp(c.layer)]
        steps = [self._reach_um(layer.z_um) / _HIDING for layer in layers]
        steps += [
            max(light.step_um, self._reach_um(light.z_um) / _SHADED) for light in traced
        ]
        area = area_um(m, self.frame, self.shift_um, 0.0)
        lattice = Lattice.over(area, max(min(steps), m.um_per_px))
        plane = None
        if scene.background_z_um is not None:
            plane = scene.background, scene.background_z_um
        found = {light.z_um: light for light in traced}
        values = crossed(layers, plane, found, lattice, m, self.focus_um)
        return self._at_pixels(values, lattice)

    def _is_traced(self, light: Light) -> bool:
        """Tell whether rays from one point meet different light at a height."""
        return self._reach_um(light.z_um) > light.step_um / 2

    def _is_sharp(self, layer: Layer) -> bool:
        """Tell whether a layer hides what is below as sharply as pixels can tell."""
        return self._reach_um(layer.z_um) <= self.microscope.um_per_px

    def _reach_um(self, z_um: float) -> float:
        """Return how far aside rays through one point of the image meet a height."""
        return self.microscope.blur_diameter_um(z_um - self.focus_um) / 2

    def _at_pixels(self, values: FloatArray, lattice: Lattice) -> FloatArray:
        x, y = places_um(self.microscope, self.frame, self.shift_um)
        return lattice.read(values, x, y)
