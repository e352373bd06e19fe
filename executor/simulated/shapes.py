"""Outlines of the simulated world with the plain geometry of contact."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import (
    JOIN_UM,
    Arc,
    Edge,
    Outline,
    Ring,
    Segment,
    flatten,
)
from microplan.schemas.files.world import WorldHole, WorldOutline, WorldPost, WorldRing
from microplan.schemas.pose import Pose

CHORD_UM = 0.02  # sagitta of flattened arcs: well below any clearance judged here
ROUNDED_UM = 0.05  # six digits of 2e4 um, the length of a finger
ROUNDED_RAD = 1e-5  # six digits of 2 pi
SPACING_UM = 2.0  # of boundary points in overlap tests: finer than any part's features


def outline_of(shape: WorldOutline) -> Outline:
    """Return the drawn outline, arcs kept."""
    return Outline(rings=tuple(_ring(ring) for ring in shape.rings))


def with_holes(outline: Outline, made: Iterable[tuple[WorldHole, float]]) -> Outline:
    """Return a part's outline with every hole grown by its own edge offset, um."""
    rings = list(outline.rings)
    for hole, offset_um in made:
        for i, ring in enumerate(rings):
            if any(_is_rim(edge, hole) for edge in ring.edges):
                rings[i] = _grown(ring, hole.center_um, 1 + offset_um / hole.radius_um)
    return Outline(rings=tuple(rings))


def made_post(post: WorldPost, offset_um: float) -> Outline:
    """Return a post's outline grown by its edge offset, um."""
    outline, ratio = outline_of(post.outline), 1 + offset_um / post.radius_um
    return Outline(rings=tuple(_grown(r, post.center_um, ratio) for r in outline.rings))


def boundary(outline: Outline) -> FloatArray:
    """Return points on all rings, at most SPACING_UM apart, (N, 2) um."""
    points = []
    for ring in outline.rings:
        corners = flatten(ring, CHORD_UM)
        ends = np.roll(corners, -1, axis=0)
        for start, end in zip(corners, ends, strict=True):
            count = max(1, math.ceil(float(np.hypot(*(end - start))) / SPACING_UM))
            share = np.arange(count)[:, None] / count
            points.append(start + share * (end - start))
    return np.concatenate(points)


def polygons(outline: Outline) -> tuple[FloatArray, ...]:
    """Return the rings as polygons, (N, 2) um each."""
    return tuple(flatten(ring, CHORD_UM) for ring in outline.rings)


def inside(points: FloatArray, rings: Iterable[FloatArray]) -> npt.NDArray[np.bool_]:
    """Return which (N, 2) um points lie in (M, 2) um `rings`, even-odd, (N,) bool."""
    odd = np.zeros(len(points), dtype=bool)
    x, y = points[:, :1], points[:, 1:]
    for ring in rings:
        x0, y0 = ring[:, 0], ring[:, 1]
        x1, y1 = np.roll(x0, -1), np.roll(y0, -1)
        spans = (y0 > y) != (y1 > y)
        rise = np.where(y1 == y0, 1.0, y1 - y0)  # flat edges never span
        crosses = spans & (x < x0 + (y - y0) * (x1 - x0) / rise)
        odd = odd ^ (np.count_nonzero(crosses, axis=1) % 2 == 1)
    return odd


def moved(points: FloatArray, pose: Pose) -> FloatArray:
    """Rotate, then shift; (N, 2) um to (N, 2) um."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    turn = np.array([[c, s], [-s, c]])
    there: FloatArray = points @ turn + np.array([pose.x_um, pose.y_um])
    return there


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


def _is_rim(edge: Edge, hole: WorldHole) -> bool:
    """Return whether an edge is part of the hole's circle, to drawing accuracy."""
    return (
        isinstance(edge, Arc)
        and math.dist(edge.center, hole.center_um) < 0.01
        and abs(edge.radius_um - hole.radius_um) < 0.01
    )


def _grown(ring: Ring, center: tuple[float, float], ratio: float) -> Ring:
    """Return a ring scaled about `center`."""
    cx, cy = center

    def out(point: tuple[float, float]) -> tuple[float, float]:
        return (cx + ratio * (point[0] - cx), cy + ratio * (point[1] - cy))

    edges: list[Edge] = []
    for edge in ring.edges:
        if isinstance(edge, Segment):
            edges.append(Segment(start=out(edge.start), end=out(edge.end)))
            continue
        radius_um = edge.radius_um * ratio
        edges.append(replace(edge, center=out(edge.center), radius_um=radius_um))
    return Ring(edges=tuple(edges), layer=ring.layer)
