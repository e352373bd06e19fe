"""Bodies as arrays of numbers, as loops over rays take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

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

    def hold(self, grids: Sequence[DistanceGrid]) -> None:
        """Take grids that are not held; where room ends, these alone are kept."""
        new = [grid for grid in dict.fromkeys(grids) if grid not in self.first]
        size = sum(grid.values.size for grid in new)
        if new and (self.used + size) * self.values.itemsize > _POOL_BYTES:
            self.first, self.used, self.values = {}, 0, self.values[:0]
            new = list(dict.fromkeys(grids))
            size = sum(grid.values.size for grid in new)
        if self.used + size > self.values.size:
            # what was handed out stays as it is
            room = np.zeros(2 * (self.used + size), dtype=np.float32)
            room[: self.used] = self.values[: self.used]
            self.values = room
        for grid in new:
            self.first[grid] = self.used
            self.values[self.used : self.used + grid.values.size] = grid.values.ravel()
            self.used += grid.values.size

    @property
    def held(self) -> Float32Array:
        """Return all of it, (N,) um, not to be changed."""
        found = self.values[: self.used]
        found.setflags(write=False)
        return found


_POOL = _Pool()


def packed(bodies: Sequence[ThickBody]) -> tuple[Float32Array, FloatArray]:
    """Return grids of distances, (N,) um, and what else is known of bodies.

    (bodies, 12): where its grid begins, columns and rows; cosine and sine in grid
    steps, the grid's own place; top, underside, um; what its walls reflect; the grid's
    step, and how far its distances go, um.
    """
    _POOL.hold([body.distance.grid for body in bodies])
    numbers = np.empty((len(bodies), 12))
    for row, body in zip(numbers, bodies, strict=True):
        at = body.distance
        (c, s), (x, y), (u, v) = at.turn, at.origin_um, at.corner_um
        rows, columns = at.values.shape
        row[:] = (
            _POOL.first[at.grid], columns, rows, c / STEP_UM, s / STEP_UM,
            -(c * x + s * y + u) / STEP_UM, -(c * y - s * x + v) / STEP_UM,
            body.top_um, body.under_um, body.wall_reflectance, STEP_UM, BEYOND_UM,
        )  # fmt: skip
    return _POOL.held, numbers
