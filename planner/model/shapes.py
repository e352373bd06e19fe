"""Outlines as shapely polygons, for collisions, shade and squeeze width."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from optics.outline import Outline, flatten

# Chord tolerance of collision and shade polygons: far below any clearance that matters
# (um), far above what would cost time.
CHORD_UM = 0.02


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
    """Return the width along x of the hull of `outline` turned by `theta_rad`."""
    x = _hull_points(outline) @ np.array([math.cos(theta_rad), -math.sin(theta_rad)])
    return float(np.ptp(x))


def squeeze_minima_rad(outline: Outline) -> tuple[float, ...]:
    """Return the turns in [0, pi) at which flat jaws along x find the hull narrowest.

    The width of a convex polygon has its local minima where an edge lies flat against a
    jaw, so only the directions of hull edges need to be tried.
    """
    points = _hull_points(outline)
    edges = np.diff(np.vstack([points, points[:1]]), axis=0)
    # turning by theta makes this edge vertical, i.e. flat against a jaw
    turns = np.sort(np.mod(math.pi / 2 - np.arctan2(edges[:, 1], edges[:, 0]), math.pi))
    turns = turns[np.diff(turns, prepend=-1.0) > 1e-9]
    step = 1e-4  # rad: probes the width on both sides of the flat position
    widths = [
        [squeeze_width_um(outline, t + d) for d in (-step, 0.0, step)] for t in turns
    ]
    return tuple(
        float(t)
        for t, (before, here, after) in zip(turns, widths, strict=True)
        if here < before and here < after
    )


def _hull_points(outline: Outline) -> np.ndarray:
    """Return the corners of the hull, (N, 2) um."""
    points: np.ndarray = shapely.get_coordinates(hull(outline))[:-1]
    return points
