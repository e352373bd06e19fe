"""A part in pictures at one stop of the stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StageStop:
    """A part in pictures at one stop of the stage, the mean of its pictures."""

    x_um: float  # readings
    y_um: float
    right_px: float  # of the picture's middle
    up_px: float
    pictures: int = 1
    scatter_px: tuple[float, float] = (0.0, 0.0)  # sums of squares of the pictures
    stretch: FloatArray | None = None  # by the drawing, (2, 2) px/um; None: not told
    offset_px: float = 0.0  # of edges, outwards; 0 where the stretch is not told
    true_share: float = 0.0  # of the stretch, by which images of the part may differ
    true_px: float = 0.0  # and by which edges may

    def straightening(self, bend: float, corner_px: float) -> FloatArray:
        """Return what takes a distortion off small lengths here, (2, 2) [1].

        The slope of seen (1 - bend |seen|^2), seen in corner radii.
        """
        seen = np.array([self.right_px, self.up_px]) / corner_px
        slope: FloatArray = np.eye(2) * (1 - bend * seen @ seen)
        return slope - 2 * bend * np.outer(seen, seen)


def shake_of(stops: Sequence[StageStop]) -> tuple[float, float]:
    """Return the standard deviation of pictures of one stop, px; 0: one each."""
    free = max(sum(stop.pictures - 1 for stop in stops), 1)
    right, up = np.sum([stop.scatter_px for stop in stops], axis=0).tolist()
    return math.sqrt(right / free), math.sqrt(up / free)
