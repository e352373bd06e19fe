"""Outlines of the simulated world as fabricated, and their extent."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.crossing import enclosed
from microplan.executor.simulated.outlines.fabricated import (
    FabricatedRing,
    fabricated_ring,
)
from microplan.executor.simulated.outlines.flattening import (
    area_um2,
    drawn_area_um2,
    polygon,
)
from microplan.schemas.files.world import WorldHole, WorldOutline, WorldPost, WorldRing

SPACING_UM = 2.0  # of boundary points in overlap tests: finer than any part's features

Fabricated = Mapping[int, FabricatedRing | None]  # by the ring's number; None: vanished


def is_hole(ring: WorldRing) -> bool:
    """Return whether a ring bounds a hole: it turns clockwise."""
    return drawn_area_um2(ring.edges) < 0


def polygons(
    shape: WorldOutline, made: Fabricated | None = None
) -> tuple[FloatArray, ...]:
    """Return the rings as counter-clockwise polygons, (N, 2) um each."""
    rings = []
    for i, ring in enumerate(shape.rings):
        if made is None or i not in made:
            rings.append(polygon(ring.edges, larger=not is_hole(ring)))
        elif (found := made[i]) is not None:
            rings.append(found.corners_um)
    return tuple(rings)


def made_post(post: WorldPost, offset_um: float) -> tuple[int, Fabricated]:
    """Return a post's rings with more material all around, and its outermost one."""
    made: dict[int, FabricatedRing | None] = {}
    for i, ring in enumerate(post.outline.rings):
        hole = is_hole(ring)
        by_um = -offset_um if hole else offset_um
        made[i] = fabricated_ring(ring.edges, by_um, post=not hole)
    areas = [drawn_area_um2(ring.edges) for ring in post.outline.rings]
    return int(np.argmax(areas)), made


def ring_of(hole: WorldHole, shape: WorldOutline) -> int | None:
    """Return the number of the ring that a named hole is, None if it is none's.

    It has an arc on the hole's circle; else it is the smallest one about its centre.
    """
    holes = [i for i, ring in enumerate(shape.rings) if is_hole(ring)]
    for i in holes:
        if any(_is_rim(edge, hole) for edge in shape.rings[i].edges):
            return i
    corners = {i: polygon(shape.rings[i].edges, larger=False) for i in holes}
    around = [i for i in holes if enclosed(np.array([hole.center_um]), corners[i])[0]]
    return min(around, key=lambda i: area_um2(corners[i]), default=None)


def boundary(rings: tuple[FloatArray, ...]) -> FloatArray:
    """Return points on all (N, 2) um rings, at most SPACING_UM apart, (K, 2) um."""
    points = []
    for corners in rings:
        ends = np.roll(corners, -1, axis=0)
        for start, end in zip(corners, ends, strict=True):
            count = max(1, math.ceil(float(np.hypot(*(end - start))) / SPACING_UM))
            share = np.arange(count)[:, None] / count
            points.append(start + share * (end - start))
    return np.concatenate(points)


def extent_x(points: FloatArray, theta_rad: float) -> tuple[float, float]:
    """Return least and most x, um, of (N, 2) um points rotated by `theta_rad`."""
    x = points[:, 0] * math.cos(theta_rad) - points[:, 1] * math.sin(theta_rad)
    return float(x.min()), float(x.max())


def _is_rim(edge: tuple[float, ...], hole: WorldHole) -> bool:
    """Return whether an edge is part of the hole's circle, to drawing accuracy."""
    return (
        len(edge) == 5
        and math.dist(edge[:2], hole.center_um) < 0.01
        and abs(edge[2] - hole.radius_um) < 0.01
    )
