"""Outlines of bodies: closed rings of segments and arcs, exact distances to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microplan.arrays import BoolArray, Box, FloatArray
from microplan.schemas.files.world import WorldOutline

CHORD_UM = 0.001  # sagitta of the polygon that decides inside and outside
FULL_RAD = 2 * math.pi
CORNER_COSINE = 0.95  # of a turn; less is a corner
POINT_UM = 1e-6  # long: an edge that has no direction
ROUNDED_RAD = 1e-5  # six digits of a full turn

Ends = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class PlaneOutline:
    """Rings of edges, um: (x0, y0, x1, y1), or (x, y, radius, start, sweep) of an arc.

    A point is inside where it lies in an odd number of rings.
    """

    rings: tuple[tuple[tuple[float, ...], ...], ...]

    @cached_property
    def polygons(self) -> tuple[FloatArray, ...]:
        """Return every ring's corners, (N, 2) um, arcs within `CHORD_UM`."""
        return tuple(_corners(ring) for ring in self.rings)

    @cached_property
    def box(self) -> Box:
        """Return least and greatest x and y: x_min, y_min, x_max, y_max."""
        points = np.concatenate(self.polygons)
        low, high = points.min(axis=0), points.max(axis=0)
        return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    @cached_property
    def corners(self) -> FloatArray:
        """Return places of corners, um, and unit vectors from there on edges, (N, 6).

        Along the edge before a corner, and along the one after it.
        """
        found = []
        for whole in self.rings:
            ring = [edge for edge in whole if _length_um(edge) > POINT_UM]
            for edge, after in zip(ring, ring[1:] + ring[:1], strict=True):
                place, into = _ways(edge)[1]
                out = _ways(after)[0][1]
                if into[0] * out[0] + into[1] * out[1] < CORNER_COSINE:
                    found.append((*place, -into[0], -into[1], *out))
        return np.array(found, dtype=float).reshape(-1, 6)

    def distance_um(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return distances to the nearest edge, (...) um, never negative."""
        least = np.full(np.broadcast(x, y).shape, np.inf)
        for ring in self.rings:
            for edge in ring:
                np.minimum(least, edge_square(edge, x, y), out=least)
        root: FloatArray = np.sqrt(least)
        return root


def read_outline(shape: WorldOutline) -> PlaneOutline:
    """Return the outline of a world file."""
    return PlaneOutline(tuple(tuple(ring.edges) for ring in shape.rings))


def parity_grid(outline: PlaneOutline, x: FloatArray, y: FloatArray) -> BoolArray:
    """Return whether each point, um, of a grid is inside, (rows, columns) bool.

    By the crossings of every row: each ring's polygon edge that spans a row changes
    inside and outside to its right.
    """
    change = np.zeros((len(y), len(x) + 1), dtype=np.int32)
    for corners in outline.polygons:
        ends = np.roll(corners, -1, axis=0)
        for (x0, y0), (x1, y1) in zip(corners, ends, strict=True):
            low, high = sorted((y0, y1))
            first, last = np.searchsorted(y, (low, high))  # rows with low <= y < high
            if first == last:
                continue
            rows = np.arange(first, last)
            cross = x0 + (y[rows] - y0) * ((x1 - x0) / (y1 - y0))
            np.add.at(change, (rows, np.searchsorted(x, cross)), 1)
    odd: BoolArray = np.cumsum(change, axis=1)[:, :-1] % 2 == 1
    return odd


def _corners(ring: tuple[tuple[float, ...], ...]) -> FloatArray:
    """Return the corners of one ring; the end of the last edge is the first start."""
    points = []
    for edge in ring:
        if len(edge) == 4:
            points.append(np.array([edge[:2]]))
            continue
        x, y, radius, start, sweep = _arc(edge)
        step = math.sqrt(8 * CHORD_UM / max(radius, CHORD_UM))
        count = max(2, math.ceil(abs(sweep) / step))
        angle = start + sweep * np.arange(count) / count
        points.append(np.c_[x + radius * np.cos(angle), y + radius * np.sin(angle)])
    return np.concatenate(points)


def _arc(edge: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Return an arc's numbers; a sweep that was rounded from a full turn is one."""
    if len(edge) != 5:
        raise ValueError(f"an edge has 4 or 5 numbers, got {len(edge)}")
    x, y, radius, start, sweep = edge
    if abs(abs(sweep) - FULL_RAD) < ROUNDED_RAD:
        sweep = math.copysign(FULL_RAD, sweep)
    return x, y, radius, start, sweep


def edge_square(edge: tuple[float, ...], x: FloatArray, y: FloatArray) -> FloatArray:
    """Return squared distances to one edge, (...) um**2, at (...) points."""
    if len(edge) == 4:
        return _segment_square(edge, x, y)
    return _arc_square(_arc(edge), x, y)


def edge_box(edge: tuple[float, ...]) -> Box:
    """Return a box that holds an edge: x_min, y_min, x_max, y_max, um."""
    if len(edge) == 4:
        x0, y0, x1, y1 = edge
        return (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
    cx, cy, radius, start, sweep = _arc(edge)
    angle = np.linspace(start, start + sweep, 33)
    x, y = cx + radius * np.cos(angle), cy + radius * np.sin(angle)
    over = radius * (1 - math.cos(sweep / 64))  # of the arc, above its chords
    return (
        float(x.min()) - over, float(y.min()) - over,
        float(x.max()) + over, float(y.max()) + over,
    )  # fmt: skip


def _segment_square(
    edge: tuple[float, ...], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return squared distances to a straight edge."""
    x0, y0, x1, y1 = edge
    dx, dy = x1 - x0, y1 - y0
    length2 = max(dx * dx + dy * dy, 1e-18)
    share = np.clip(((x - x0) * dx + (y - y0) * dy) / length2, 0.0, 1.0)
    square: FloatArray = (x - x0 - share * dx) ** 2 + (y - y0 - share * dy) ** 2
    return square


def _arc_square(
    arc: tuple[float, float, float, float, float], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return squared distances to an arc: its circle, or the nearer of its ends."""
    cx, cy, radius, start, sweep = arc
    dx, dy = x - cx, y - cy
    circle = (np.hypot(dx, dy) - radius) ** 2
    if abs(sweep) == FULL_RAD:
        return circle
    middle, half = start + sweep / 2, abs(sweep) / 2
    # the angle off the arc's middle, by its cosine: no angle of a point is needed
    along = dx * math.cos(middle) + dy * math.sin(middle)
    beside = along >= np.hypot(dx, dy) * math.cos(half)
    (ax, ay), (bx, by) = _arc_ends(arc)
    ends = np.minimum((x - ax) ** 2 + (y - ay) ** 2, (x - bx) ** 2 + (y - by) ** 2)
    square: FloatArray = np.where(beside, circle, ends)
    return square


def _arc_ends(arc: tuple[float, float, float, float, float]) -> Ends:
    """Return both ends of an arc, um."""
    cx, cy, radius, start, sweep = arc
    first, last = (
        (cx + radius * math.cos(a), cy + radius * math.sin(a))
        for a in (start, start + sweep)
    )
    return first, last


def _length_um(edge: tuple[float, ...]) -> float:
    """Return how long an edge is."""
    if len(edge) == 4:
        return math.dist(edge[:2], edge[2:])
    return abs(edge[2] * _arc(edge)[4])


def _ways(edge: tuple[float, ...]) -> tuple[Ends, Ends]:
    """Return an edge's start and end, um, each with the unit vector along it."""
    if len(edge) == 4:
        x0, y0, x1, y1 = edge
        length = _length_um(edge)
        way = ((x1 - x0) / length, (y1 - y0) / length)
        return ((x0, y0), way), ((x1, y1), way)
    _, _, _, start, sweep = arc = _arc(edge)
    side = math.copysign(1.0, sweep)
    first, last = (
        (-side * math.sin(a), side * math.cos(a)) for a in (start, start + sweep)
    )
    begin, end = _arc_ends(arc)
    return (begin, first), (end, last)
