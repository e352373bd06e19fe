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
from microplan.optics.outline.outline import (
    JOIN_UM,
    Arc,
    Edge,
    Outline,
    Ring,
    Segment,
)
from microplan.schemas.files.world import WorldHole, WorldOutline, WorldPost, WorldRing

ROUNDED_UM = 0.05  # six digits of 2e4 um, the length of a finger
ROUNDED_RAD = 1e-5  # six digits of 2 pi
SPACING_UM = 2.0  # of boundary points in overlap tests: finer than any part's features

Fabricated = Mapping[int, FabricatedRing | None]  # by the ring's number; None: vanished


def outline_of(shape: WorldOutline, made: Fabricated | None = None) -> Outline:
    """Return an outline with arcs, its fabricated rings in place of drawn ones."""
    rings = []
    for i, ring in enumerate(shape.rings):
        if made is None or i not in made:
            rings.append(_ring(ring))
        elif (found := made[i]) is not None:
            rings.append(_fabricated(found, hole=is_hole(ring), layer=ring.layer))
    return Outline(rings=tuple(rings))


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


def _ring(ring: WorldRing) -> Ring:
    """Return a ring of edges from its numbers.

    Numbers in a file are rounded: ends that no longer meet are joined by a straight
    edge, so short that no image or contact shows it.
    """
    drawn = [_edge(edge) for edge in ring.edges]
    edges: list[Edge] = []
    for edge, after in zip(drawn, drawn[1:] + drawn[:1], strict=True):
        edges.append(edge)
        if JOIN_UM / 10 < math.dist(edge.end, after.start) <= ROUNDED_UM:
            edges.append(Segment(start=edge.end, end=after.start))
    return Ring(edges=tuple(edges), layer=ring.layer)


def _edge(numbers: tuple[float, ...]) -> Edge:
    """Return a segment (4 numbers) or an arc (5)."""
    if len(numbers) == 4:
        x0, y0, x1, y1 = numbers
        return Segment(start=(x0, y0), end=(x1, y1))
    if len(numbers) != 5:
        raise ValueError(f"an edge has 4 or 5 numbers, got {len(numbers)}")
    x, y, radius, start, sweep = numbers
    if abs(abs(sweep) - 2 * math.pi) < ROUNDED_RAD:
        sweep = math.copysign(2 * math.pi, sweep)  # a circle stays closed
    return Arc(center=(x, y), radius_um=radius, start_rad=start, sweep_rad=sweep)


def _is_rim(edge: tuple[float, ...], hole: WorldHole) -> bool:
    """Return whether an edge is part of the hole's circle, to drawing accuracy."""
    return (
        len(edge) == 5
        and math.dist(edge[:2], hole.center_um) < 0.01
        and abs(edge[2] - hole.radius_um) < 0.01
    )


def _fabricated(made: FabricatedRing, *, hole: bool, layer: str) -> Ring:
    """Return a fabricated ring as edges, in the sense of its kind."""
    sense = -1 if hole else 1
    if made.round_um is not None:
        circle = Arc(
            center=made.center_um, radius_um=made.round_um, start_rad=0.0,
            sweep_rad=sense * math.tau,
        )  # fmt: skip
        return Ring(edges=(circle,), layer=layer)
    corners = [(float(x), float(y)) for x, y in made.corners_um[::sense]]
    ends = corners[1:] + corners[:1]
    edges = (Segment(start=a, end=b) for a, b in zip(corners, ends, strict=True))
    return Ring(edges=tuple(edges), layer=layer)
