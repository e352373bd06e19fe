"""Bodies as arrays of numbers, as loops over rays take them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.solids.straight_rays import ThickBody
from microplan.optics.outline.distance_field import BEYOND_UM, STEP_UM, DistanceGrid
from microplan.optics.transfer.lru import Recent

_JOINED_BYTES = 1 << 25  # of grids: those of a look's images


def packed(bodies: Sequence[ThickBody]) -> tuple[Float32Array, FloatArray]:
    """Return all grids of distances, (N,) um, and what else is known of bodies.

    (bodies, 12): where its grid begins, columns and rows; cosine and sine in grid
    steps, the grid's own place; top, underside, um; what its walls reflect; the grid's
    step, and how far its distances go, um.
    """
    numbers = np.empty((len(bodies), 12))
    first = 0
    for row, body in zip(numbers, bodies, strict=True):
        field = body.distance
        (c, s), (x, y), (u, v) = field.turn, field.origin_um, field.corner_um
        rows, columns = field.values.shape
        row[:] = (
            first, columns, rows, c / STEP_UM, s / STEP_UM,
            -(c * x + s * y + u) / STEP_UM, -(c * y - s * x + v) / STEP_UM,
            body.top_um, body.under_um, body.wall_reflectance, STEP_UM, BEYOND_UM,
        )  # fmt: skip
        first += field.values.size
    return _joined(tuple(body.distance.grid for body in bodies)), numbers


_JOINED: Recent[Float32Array] = Recent(_JOINED_BYTES, lambda found: found.nbytes)


def _joined(grids: tuple[DistanceGrid, ...]) -> Float32Array:
    """Return the distances of grids one after the other, (N,) um: bodies only move."""
    return _JOINED.get(grids, partial(_concatenated, grids))


def _concatenated(grids: tuple[DistanceGrid, ...]) -> Float32Array:
    """Return new ones, not to be changed."""
    found = np.concatenate(
        [np.zeros(0, dtype=np.float32), *(grid.values.ravel() for grid in grids)]
    )
    found.setflags(write=False)
    return found
