"""Rings as they are seen: pieces of one line or circle joined, stubs left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Segment, flatten

SAME = 1e-5  # of the extent: what is this near is the same point, line or circle
STUB = 1e-4  # of the extent: shorter edges are drawing errors, 10 nm of 100 um
CHORD = 1e-4  # of the extent: arcs are flattened so finely where shapes are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Clean:
    """A ring without stubs; the material lies on the left of every edge.

    Neighbours may be apart by as much as the stubs that lay between them.
    """

    edges: tuple[Edge, ...]
    points: FloatArray  # (N, 2) um along the whole ring, the first not repeated
    hole: bool

    @property
    def length_um(self) -> float:
        """Return the length of the edges."""
        return sum(edge.length_um for edge in self.edges)


def clean(outline: Outline) -> tuple[Clean, ...]:
    """Return the outline's rings, cleaned, in their order.

    Which side the material is on follows from how rings lie in each other, whatever way
    they are run. A ring that is all stubs is left out.
    """
    extent = extent_um(outline)
    points = [flatten(ring, CHORD * extent) for ring in outline.rings]
    low = np.array([run.min(axis=0) for run in points])
    high = np.array([run.max(axis=0) for run in points])
    found = []
    for k, ring in enumerate(outline.rings):
        start = points[k][0]
        near = ((low <= start) & (start <= high)).all(axis=1)
        around = [j for j in np.flatnonzero(near).tolist() if j != k]
        hole = sum(inside(start, points[j]) for j in around) % 2 == 1
        turned = (ring.signed_area_um2 < 0) != hole
        edges = _joined((ring.reversed() if turned else ring).edges, extent)
        if edges:
            run = points[k][::-1] if turned else points[k]
            found.append(Clean(edges=edges, points=run, hole=hole))
    return tuple(found)


def extent_um(outline: Outline) -> float:
    """Return the diagonal of the outline's bounds: what its tolerances scale with."""
    x0, y0, x1, y1 = outline.bounds_um
    return math.hypot(x1 - x0, y1 - y0)


def inside(point: FloatArray, polygon: FloatArray) -> bool:
    """Return whether a (2,) point, um, lies in an (N, 2) polygon, by crossings."""
    x, y = point
    x0, y0 = polygon.T
    x1, y1 = np.roll(polygon, -1, axis=0).T
    across = (y0 > y) != (y1 > y)
    if not across.any():
        return False
    x0, y0, x1, y1 = x0[across], y0[across], x1[across], y1[across]
    left = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return bool(np.count_nonzero(left) % 2)


def same_circle(a: Arc, b: Arc, within_um: float) -> bool:
    """Return whether two arcs lie on one circle."""
    apart = math.dist(a.center, b.center)
    return apart <= within_um and abs(a.radius_um - b.radius_um) <= within_um


def _joined(edges: Sequence[Edge], extent: float) -> tuple[Edge, ...]:
    """Return the edges without stubs, neighbours on one line or circle as one."""
    kept = [edge for edge in edges if edge.length_um > STUB * extent]
    if not kept:
        return ()
    groups: list[list[Edge]] = []
    for edge in kept:
        if groups and _continues(groups[-1], edge, extent):
            groups[-1].append(edge)
        else:
            groups.append([edge])
    # the ring's first edge may go on from its last
    if len(groups) > 1 and all(
        _continues(groups[-1] + groups[0][:k], groups[0][k], extent)
        for k in range(len(groups[0]))
    ):
        groups[0] = groups.pop() + groups[0]
    return tuple(_one(group) for group in groups)


def _continues(group: Sequence[Edge], edge: Edge, extent: float) -> bool:
    """Return whether `edge` is more of what `group` is a piece of."""
    first, within = group[0], SAME * extent
    if isinstance(first, Arc) and isinstance(edge, Arc):
        turned = sum(e.sweep_rad for e in (*group, edge) if isinstance(e, Arc))
        alike = first.sweep_rad * edge.sweep_rad > 0
        whole = abs(turned) <= math.tau * (1 + 1e-9)
        return alike and whole and same_circle(first, edge, within)
    if isinstance(first, Segment) and isinstance(edge, Segment):
        joints = [e.end for e in group]
        return all(_between(p, first.start, edge.end, within) for p in joints)
    return False


def _between(point: Point, start: Point, end: Point, within_um: float) -> bool:
    """Return whether `point` lies on the straight way from `start` to `end`."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    px, py = point[0] - start[0], point[1] - start[1]
    length = math.hypot(dx, dy)
    if length <= within_um:
        return False
    off = abs(dx * py - dy * px) / length
    return off <= within_um and 0 <= px * dx + py * dy <= length**2


def _one(group: Sequence[Edge]) -> Edge:
    """Return the pieces of one line or circle as one edge."""
    first = group[0]
    if isinstance(first, Segment):
        return replace(first, end=group[-1].end)
    turned = sum(e.sweep_rad for e in group if isinstance(e, Arc))
    return replace(first, sweep_rad=max(-math.tau, min(math.tau, turned)))
