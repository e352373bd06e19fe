"""Rings of a layer by size, and the one of them that a feature means."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import Outline, Ring, flatten
from microplan.planner.drawings.rings import cell

MOST_LISTED = 8
_CHORD = 1e-4  # of a ring's extent: by which its corners miss an arc


def by_size(rings: Sequence[Ring]) -> list[Ring]:
    """Return the rings, the largest first; equal ones from left to right, then up.

    However they were drawn: tasks count them in this order, from 1.
    """

    def rank(ring: Ring) -> tuple[int, ...]:
        box = Outline(rings=(ring,)).bounds_um
        # the area of a square whose side is rounded like a place
        return (-cell(math.sqrt(abs(ring.signed_area_um2))), *map(cell, box))

    return sorted(rings, key=rank)


def nearest(rings: Sequence[Ring], point_um: Point) -> Ring:
    """Return the smallest ring around a point, else the one with the nearest edge."""
    around = [ring for ring in rings if _holds(corners(ring), point_um)]
    if around:
        return by_size(around)[-1]
    return min(by_size(rings), key=lambda ring: _away_um(corners(ring), point_um))


def listed(rings: Sequence[Ring], unit_um: float) -> str:
    """Return the rings by number with size and place, the first few, in a unit."""
    ranked = by_size(rings)
    said = []
    for number, ring in enumerate(ranked[:MOST_LISTED], 1):
        x0, y0, x1, y1 = (c / unit_um for c in Outline(rings=(ring,)).bounds_um)
        x, y = (x0 + x1) / 2 + 0.0, (y0 + y1) / 2 + 0.0
        size = f"{x1 - x0:.4g} x {y1 - y0:.4g}"
        said.append(f"{number} is {size} about ({x:.4g}, {y:.4g})")
    more = len(ranked) - len(said)
    return ", ".join(said) + (f" and {more} more" if more > 0 else "")


def corners(ring: Ring) -> FloatArray:
    """Return a ring as a fine polygon, (N, 2) um."""
    x0, y0, x1, y1 = Outline(rings=(ring,)).bounds_um
    return flatten(ring, _CHORD * math.hypot(x1 - x0, y1 - y0))


def _holds(polygon: FloatArray, point: Point) -> bool:
    """Return whether an (N, 2) polygon is around a point, by crossings."""
    x, y = point
    (x0, y0), (x1, y1) = polygon.T, np.roll(polygon, -1, axis=0).T
    across = (y0 > y) != (y1 > y)
    share = (y - y0[across]) / (y1 - y0)[across]
    crossed = x < x0[across] + share * (x1 - x0)[across]
    return bool(np.count_nonzero(crossed) % 2)


def _away_um(polygon: FloatArray, point: Point) -> float:
    """Return the distance of a point from an (N, 2) polygon's edges."""
    start = polygon - np.array(point)
    along = np.roll(polygon, -1, axis=0) - polygon
    square = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(-(start * along).sum(axis=1) / square, 0.0, 1.0)
    return float(np.hypot(*(start + share[:, None] * along).T).min())
