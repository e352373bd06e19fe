"""Frames of one still scene in several lights, added up as they are read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from microplan.arrays import FloatArray
from microplan.planner.calibration.picture_intake import PictureIntake
from microplan.planner.calibration.response.light_levels import LightStep
from microplan.planner.calibration.still_frames import StillScene

_MOST_PX = 60_000  # of a picture that are kept, evenly over it: more are not fitted


@dataclass(slots=True, kw_only=True)
class LightScenes:
    """Frames of each light, added up."""

    top: int = 0
    scenes: dict[float, StillScene] = field(default_factory=dict)
    numbers: dict[float, list[int]] = field(default_factory=dict)  # of pictures

    def add(self, light: float, counts: FloatArray, intake: PictureIntake) -> None:
        """Take a picture (rows, columns), counts, of which some pixels are kept."""
        self.top = intake.top
        self.numbers.setdefault(light, []).append(intake.taken)
        if light in self.scenes:
            self.scenes[light].add(counts)
        else:
            every = math.ceil(math.sqrt(counts.size / _MOST_PX))
            self.scenes[light] = StillScene.of(counts, self.top, every=every)

    @property
    def steps(self) -> list[LightStep]:
        """Return the lights with their frames, rising."""
        lights = sorted(self.scenes.items())
        return [LightStep(light=light, scene=scene) for light, scene in lights]
