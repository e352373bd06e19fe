"""Mean light across a part's edges, the part placed on its edges to 1/1000 px."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import ndimage

from microplan.arrays import BoolArray, FloatArray
from microplan.planner.calibration.geometry.drawn_edges import edge_offsets
from microplan.planner.calibration.through_focus.edge_profile import (
    EdgePoints,
    across_px,
)

_ORDER: Final = 5  # of splines: of a sharp edge's pixels a cubic one errs by some 1e-3
_ROUNDS = 4  # of placing and measuring
_FEWEST = 40  # points
_MIXED = 0.2  # of distances along normals, their scatter: else scale looks like offset


def edge_mean(
    points: EdgePoints, shown: FloatArray, at_px: tuple[float, float]
) -> FloatArray | None:
    """Return the mean light across edges, (L,) from inside outwards; None: not seen.

    Place, angle and, where `tells_scale`, size are those of the edges seen, so that
    only their common offset is left.

    Parameters
    ----------
    points : EdgePoints
        The edges, at about the part's angle.
    shown : (rows, columns) float array
        Light, 0..1.
    at_px : (column, row)
        About where the part is.
    """
    knots = ndimage.spline_filter(shown, order=_ORDER, mode="nearest")
    where, middle, scaled = points.where(at_px), np.array(at_px), tells_scale(points)
    for _ in range(_ROUNDS):
        edges, good = edge_offsets(_profiles(knots, where))
        if good.sum() < _FEWEST:
            return None
        right, down, across, along = (where - np.append(middle, (0, 0))).T
        turn, size = right * along - down * across, right * across + down * along
        columns = [across, along, np.ones(len(edges)), turn, size][: 4 + scaled]
        found = np.linalg.lstsq(np.stack(columns)[:, good].T, edges[good], rcond=1e-9)
        where, middle = _moved(where, middle, np.append(found[0], 0.0))
    values = _profiles(knots, where)
    whole = np.isfinite(values).all(axis=1)
    if whole.sum() < _FEWEST:
        return None
    return np.asarray(values[whole].mean(axis=0))


def tells_scale(points: EdgePoints) -> bool:
    """Return whether edges tell the drawing's scale apart from their own offset."""
    x, y, across, along = points.where((0.0, 0.0)).T
    out = x * across + y * along
    return bool(np.std(out) > _MIXED * np.sqrt(np.mean(out**2)))


def _moved(
    where: FloatArray, middle: FloatArray, numbers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points (M, 4) px and their middle, moved by shift, -, turn and scale."""
    (right, down), turn, scale = numbers[:2], float(numbers[3]), float(numbers[4])
    around = np.array([[1 + scale, -turn], [turn, 1 + scale]])
    found = where.copy()
    found[:, :2] = middle + (where[:, :2] - middle) @ around.T + (right, down)
    normals = where[:, 2:] @ np.array([[1.0, -turn], [turn, 1.0]]).T
    found[:, 2:] = normals / np.linalg.norm(normals, axis=1)[:, None]
    return found, middle + (right, down)


def _profiles(knots: FloatArray, where: FloatArray) -> FloatArray:
    """Return light along the normals of points (M, 4), (M, L); nan outside."""
    column, row, across, along = where.T[:, :, None]
    x, y = column + across * across_px(), row + along * across_px()
    found = ndimage.map_coordinates(
        knots, [y, x], order=_ORDER, mode="nearest", prefilter=False
    )
    inside = _within(x, knots.shape[1]) & _within(y, knots.shape[0])
    return np.where(inside, found, np.nan)


def _within(values: FloatArray, size: int) -> BoolArray:
    return np.asarray((values >= 0) & (values <= size - 1))
