"""Outlines as shapely polygons, for collisions, shade, squeeze width."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from microplan.optics.outline.outline import Outline, flatten

# Chord tolerance of collision and shade polygons: far below any clearance that matters
# (um), far above what would cost time.
CHORD_UM = 0.02
# Chords of opposite arcs make the width dip by up to twice the chord tolerance.
DIMPLE_UM = 2 * CHORD_UM
_KEPT = 256  # outlines whose shapes are kept: each step asks for those of all parts


@lru_cache(maxsize=_KEPT)
def polygon(outline: Outline) -> BaseGeometry:
    """Return `outline` as a (multi)polygon, arcs within CHORD_UM of the truth."""
    rings = [flatten(ring, CHORD_UM) for ring in outline.rings]
    outers = [
        Polygon(points)
        for ring, points in zip(outline.rings, rings, strict=True)
        if ring.signed_area_um2 > 0
    ]
    holes = [
        Polygon(points)
        for ring, points in zip(outline.rings, rings, strict=True)
        if ring.signed_area_um2 < 0
    ]
    solid: BaseGeometry = shapely.union_all(outers)
    return solid.difference(shapely.union_all(holes)) if holes else solid


@lru_cache(maxsize=_KEPT)
def hull(outline: Outline) -> BaseGeometry:
    """Return the convex hull of `outline`."""
    convex: BaseGeometry = polygon(outline).convex_hull
    return convex


def swept(shape: BaseGeometry, box: tuple[float, float, float, float]) -> BaseGeometry:
    """Return what a convex `shape` covers while its offset runs over `box`.

    The Minkowski sum of a convex shape and a rectangle is the hull of the shape at the
    rectangle's corners; `box` is (x_min, y_min, x_max, y_max), um.
    """
    x0, y0, x1, y1 = box
    corners = [
        shapely.affinity.translate(shape, dx, dy) for dx in (x0, x1) for dy in (y0, y1)
    ]
    covered: BaseGeometry = shapely.union_all(corners).convex_hull
    return covered


def squeeze_width_um(outline: Outline, theta_rad: float) -> float:
    """Return the width along x of the hull of `outline` rotated by `theta_rad`."""
    return _width_um(_hull_points(outline), theta_rad)


def squeeze_minima_rad(outline: Outline) -> tuple[float, ...]:
    """Return the angles in [0, pi) at which flat jaws along x find the hull narrowest.

    The width of a convex polygon has its local minima where an edge lies flat against a
    jaw, so only the directions of hull edges need to be tried. A minimum that is less
    than DIMPLE_UM deep is a chord of an arc, along which the part rotates freely: it
    does not count, and a disc has none.
    """
    points = _hull_points(outline)
    edges = np.diff(np.vstack([points, points[:1]]), axis=0)
    # rotation by theta makes this edge vertical, i.e. flat against a jaw
    flat = np.sort(np.mod(math.pi / 2 - np.arctan2(edges[:, 1], edges[:, 0]), math.pi))
    angles_rad: list[float] = flat[np.diff(flat, prepend=-1.0) > 1e-9].tolist()
    widths = [_width_um(points, t) for t in angles_rad]
    ends = zip(
        [*angles_rad[1:], angles_rad[0] + math.pi],
        [*widths[1:], widths[0]],
        strict=True,
    )
    tops = [
        _top_um((t, w), end) for t, w, end in zip(angles_rad, widths, ends, strict=True)
    ]
    return _deep(angles_rad, widths, tops)


def _top_um(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the greatest width from one flat position to the next, each (rad, um).

    Between them the jaws touch one pair of corners, whose distance along x is a cosine
    of the angle.
    """
    (a, width_a), (b, width_b) = start, end
    rows = [[math.cos(a), math.sin(a)], [math.cos(b), math.sin(b)]]
    if math.isclose(math.sin(b - a), 0.0, abs_tol=1e-9):
        return max(width_a, width_b)  # the same position twice, pi apart
    c, s = np.linalg.solve(np.array(rows), np.array([width_a, width_b]))
    peak = a + math.remainder(math.atan2(s, c) - a, 2 * math.pi)
    return float(math.hypot(c, s)) if a < peak < b else max(width_a, width_b)


def _deep(
    angles_rad: list[float], widths: list[float], tops: list[float]
) -> tuple[float, ...]:
    """Return the angles of the minima that are at least DIMPLE_UM deep.

    `tops[i]` is the greatest width between angles i and i + 1, cyclic. The shallowest
    minimum goes first, of equals the widest; its neighbours then see over it.
    """
    left = list(zip(angles_rad, widths, tops, strict=True))
    while left:
        depths = [
            (min(left[i - 1][2], top) - width, -width)
            for i, (_, width, top) in enumerate(left)
        ]
        shallow = depths.index(min(depths))
        if depths[shallow][0] >= DIMPLE_UM:
            break
        _, _, top = left.pop(shallow)
        if left:
            turn, width, before = left[shallow - 1]
            left[shallow - 1] = (turn, width, max(before, top))
    return tuple(turn for turn, _, _ in left)


def _width_um(points: np.ndarray, theta_rad: float) -> float:
    """Return the width along x of points rotated by `theta_rad`."""
    x = points @ np.array([math.cos(theta_rad), -math.sin(theta_rad)])
    return float(np.ptp(x))


def _hull_points(outline: Outline) -> np.ndarray:
    """Return the corners of the hull, (N, 2) um."""
    points: np.ndarray = shapely.get_coordinates(hull(outline))[:-1]
    return points
