"""Bodies as arrays of numbers, as loops over rays take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock

import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.solids.straight_rays import ThickBody
from microplan.optics.outline.distance_field import BEYOND_UM, STEP_UM, DistanceGrid

_POOL_BYTES = 1 << 25  # of grids: those of a look's images


@dataclass(slots=True)
class _Pool:
    """Grids of distances one after the other: bodies only move, so few are new."""

    values: Float32Array = field(default_factory=lambda: np.zeros(0, dtype=np.float32))
    used: int = 0
    first: dict[DistanceGrid, int] = field(default_factory=dict)  # where each begins
    lock: Lock = field(default_factory=Lock)

    def hold(self, grids: Sequence[DistanceGrid]) -> tuple[Float32Array, list[int]]:
        """Return all that is held, (N,) um, and where each of some grids begins.

        Where room ends, these alone are kept. What was returned before stays as it is.
        """
        with self.lock:
            new = [grid for grid in dict.fromkeys(grids) if grid not in self.first]
            if new and self._bytes(new) > _POOL_BYTES:
                self.first, self.used, self.values = {}, 0, self.values[:0]
                new = list(dict.fromkeys(grids))
            self._take(new)
            found = self.values[: self.used]
            found.setflags(write=False)
            return found, [self.first[grid] for grid in grids]

    def _bytes(self, more: Sequence[DistanceGrid]) -> int:
        size = self.used + sum(grid.values.size + grid.corners.size for grid in more)
        return size * self.values.itemsize

    def _take(self, new: Sequence[DistanceGrid]) -> None:
        """Take grids that are not held."""
        size = self._bytes(new) // self.values.itemsize
        if size > self.values.size:
            most = _POOL_BYTES // self.values.itemsize
            room = np.zeros(min(2 * size, max(size, most)), dtype=np.float32)
            room[: self.used] = self.values[: self.used]
            self.values = room
        for grid in new:
            own = np.concatenate([grid.values.ravel(), grid.corners.ravel()])
            end = self.used + own.size
            self.values[self.used : end] = own
            self.first[grid], self.used = self.used, end


_POOL = _Pool()


def packed(bodies: Sequence[ThickBody]) -> tuple[Float32Array, FloatArray]:
    """Return grids of distances with corners, (N,), and what else is known of bodies.

    (bodies, 13): where its grid begins, columns and rows; cosine and sine in grid
    steps, the grid's own place; top, underside, um; what its walls reflect; the grid's
    step, and how far its distances go, um; how many corners follow the grid.
    """
    grids, starts = _POOL.hold([body.distance.grid for body in bodies])
    numbers = np.empty((len(bodies), 13))
    for row, first, body in zip(numbers, starts, bodies, strict=True):
        distance = body.distance
        (c, s), (x, y) = distance.turn, distance.origin_um
        (u, v), (rows, columns) = distance.corner_um, distance.values.shape
        row[:] = (
            first, columns, rows, c / STEP_UM, s / STEP_UM,
            -(c * x + s * y + u) / STEP_UM, -(c * y - s * x + v) / STEP_UM,
            body.top_um, body.under_um, body.wall_reflectance, STEP_UM, BEYOND_UM,
            distance.grid.corners.shape[1],
        )  # fmt: skip
    return grids, numbers
