"""Convex pieces that together are a polygon."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import Polygon

from microplan.arrays import FloatArray, IntArray

# Corners that turn inward by less than this, as the sine, count as straight.
STRAIGHT = 1e-9
Cycle = list[int]  # corners of a piece, counter-clockwise


def convex_cover(points: FloatArray) -> tuple[FloatArray, ...]:
    """Return convex polygons whose union is a simple polygon.

    Parameters
    ----------
    points : (N, 2) float array
        Corners in order, any unit, the first not repeated.

    Returns
    -------
    tuple of (M, 2) float arrays
        Corners counter-clockwise. One for a convex polygon; at most four times as many
        as the fewest possible.

    References
    ----------
    Hertel & Mehlhorn (1983), Fast triangulation of simple polygons: diagonals that no
    corner needs to stay convex are left out.
    """
    faces = shapely.get_parts(shapely.constrained_delaunay_triangles(Polygon(points)))
    corners = [shapely.get_coordinates(face)[:3] for face in faces]
    sites, index = np.unique(np.concatenate(corners), axis=0, return_inverse=True)
    cycles = {
        k: _rising(triple, sites) for k, triple in enumerate(index.reshape(-1, 3))
    }
    sides = {edge: k for k, cycle in cycles.items() for edge in _edges(cycle)}
    for edge in sorted(sides):
        left, right = sides.get(edge), sides.get(edge[::-1])
        if left is None or right is None or left == right:
            continue
        joined = _joined(cycles[left], cycles[right], edge)
        if not _is_convex(joined, edge, sites):
            continue
        del sides[edge], sides[edge[::-1]], cycles[right]
        cycles[left] = joined
        sides |= dict.fromkeys(_edges(joined), left)
    return tuple(sites[cycle] for cycle in cycles.values())


def _rising(triple: IntArray, sites: FloatArray) -> Cycle:
    """Return a triangle's corners counter-clockwise."""
    i, j, k = (int(corner) for corner in triple)
    (ax, ay), (bx, by) = sites[j] - sites[i], sites[k] - sites[i]
    return [i, j, k] if ax * by - ay * bx > 0 else [i, k, j]


def _edges(cycle: Cycle) -> list[tuple[int, int]]:
    return list(zip(cycle, cycle[1:] + cycle[:1], strict=True))


def _joined(left: Cycle, right: Cycle, edge: tuple[int, int]) -> Cycle:
    """Return two pieces as one, without the edge that they share."""
    i, j = edge
    at, back = left.index(j), right.index(i)
    one, other = left[at:] + left[:at], right[back:] + right[:back]
    return one + other[1:-1]


def _is_convex(cycle: Cycle, edge: tuple[int, int], sites: FloatArray) -> bool:
    """Return whether a piece is convex at both ends of an edge that was in it."""
    for corner in edge:
        at = cycle.index(corner)
        before, after = cycle[at - 1], cycle[(at + 1) % len(cycle)]
        (ax, ay), (bx, by) = sites[corner] - sites[before], sites[after] - sites[corner]
        if ax * by - ay * bx < -STRAIGHT * np.hypot(ax, ay) * np.hypot(bx, by):
            return False
    return True
