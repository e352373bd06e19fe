"""Edges that run along each other for a stretch: each stretch taken once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import shapely

from microplan.arrays import Point
from microplan.optics.outline.outline import JOIN_UM, Arc, Edge, Segment, edge_bounds
from microplan.planner.drawings.pieces import Piece
from microplan.planner.drawings.rings import edge_key, same_circle

_ALONG_UM = 1e-3  # edges closer than this run along each other: 1 nm, as keys have it
_LEAST_UM = 0.01  # of an overlap: shorter ones are gaps that went too far
_CHUNK = 64  # edges whose neighbours are sought at a time
_MOST_PAIRS = 200_000  # of edges with touching boxes; more is a tangle, not a part
_MOST_SHARED = 20_000  # pairs that run along each other: every edge drawn twice


def without_overlaps(pieces: Sequence[Piece]) -> tuple[list[Piece], tuple[str, ...]]:
    """Return pieces with shared stretches once, and the handles of the repetitions.

    Edges that overlap in part are cut where the other one ends; a closed piece of which
    an edge is cut falls apart, so that junctions show.
    """
    edges = [(k, edge) for k, piece in enumerate(pieces) for edge in piece.edges]
    cuts: dict[int, list[Point]] = {}
    shared = list(islice(_overlapping([e for _, e in edges]), _MOST_SHARED + 1))
    if len(shared) > _MOST_SHARED:
        return list(pieces), ()  # ends within edges stay, and are refused later
    for i, j in shared:
        if edges[i][0] == edges[j][0]:
            continue  # a ring that runs back on itself encloses nothing: said later
        for one, other in ((i, j), (j, i)):
            ends = edges[other][1].start, edges[other][1].end
            cuts.setdefault(one, []).extend(ends)
    if not cuts:
        return list(pieces), ()
    touched = {edges[index][0] for index in cuts}
    kept = [piece for k, piece in enumerate(pieces) if k not in touched]
    once: dict[object, Piece] = {}
    again: list[str] = []
    for index, (k, edge) in enumerate(edges):
        if k not in touched:
            continue
        for part in _cut(edge, cuts.get(index, [])):
            piece = replace(pieces[k], edges=(part,), closed=False)
            if once.setdefault(edge_key(part), piece) is not piece:
                again.append(piece.handle)
    return kept + list(once.values()), tuple(dict.fromkeys(again))


def _overlapping(edges: Sequence[Edge]) -> Iterator[tuple[int, int]]:
    """Yield pairs of edges that run along each other for a stretch."""
    if len(edges) < 2:
        return
    bounds = np.array([edge_bounds(edge) for edge in edges])
    boxes = shapely.box(*(bounds + [-_ALONG_UM, -_ALONG_UM, _ALONG_UM, _ALONG_UM]).T)
    tree = shapely.STRtree(boxes)
    seen = 0
    for first in range(0, len(edges), _CHUNK):
        near = tree.query(boxes[first : first + _CHUNK])
        seen += near.shape[1]
        if seen > _MOST_PAIRS:
            return  # such edges cross, and that is refused later
        for row, j in near.T.tolist():
            i = first + row
            if i < j and _shared_um(edges[i], edges[j]) > _LEAST_UM:
                yield i, j


def _shared_um(a: Edge, b: Edge) -> float:
    """Return the length that two edges have in common, um."""
    if isinstance(a, Segment) and isinstance(b, Segment):
        if a.length_um < b.length_um:
            a, b = b, a
        along, length = _frame(a)
        local = [_local(a, along, point) for point in (b.start, b.end)]
        if any(abs(z.imag) > _ALONG_UM for z in local):
            return 0.0
        low, high = sorted(z.real for z in local)
        return min(high, length) - max(low, 0.0)
    if isinstance(a, Arc) and isinstance(b, Arc) and same_circle(a, b, _ALONG_UM):
        spans = [
            min(high, abs(a.sweep_rad)) - max(low, 0.0) for low, high in _turns(a, b)
        ]
        return a.radius_um * sum(span for span in spans if span > 0)
    return 0.0


def _turns(a: Arc, b: Arc) -> Iterator[tuple[float, float]]:
    """Yield where `b` lies along the sweep of `a`, with and without 2 pi less."""
    low = _angle(a, b.start if b.sweep_rad * a.sweep_rad > 0 else b.end)
    if b.is_circle:
        low = 0.0
    for turn in (0.0, -math.tau):
        yield low + turn, low + turn + abs(b.sweep_rad)


def _cut(edge: Edge, points: Sequence[Point]) -> list[Edge]:
    """Return an edge cut at those points that lie within it."""
    if isinstance(edge, Segment):
        along, length = _frame(edge)
        places = sorted((_local(edge, along, point).real, point) for point in points)
        inside = [p for at, p in places if _LEAST_UM < at < length - _LEAST_UM]
        corners = _once([edge.start, *inside, edge.end])
        return [Segment(start=a, end=b) for a, b in pairwise(corners)]
    least = _LEAST_UM / edge.radius_um
    angles = sorted(_angle(edge, point) for point in points)
    if edge.is_circle and angles:  # begins at the first cut: its seam means nothing
        start = edge.start_rad + math.copysign(angles[0], edge.sweep_rad)
        edge = replace(edge, start_rad=start)
        angles = [angle - angles[0] for angle in angles]
    whole = abs(edge.sweep_rad)
    stops = [0.0, *(x for x in angles if least < x < whole - least), whole]
    kept = [stops[0]]
    for stop in stops[1:]:
        if stop - kept[-1] > least / 2:
            kept.append(stop)
    return [_stretch(edge, x, y) for x, y in pairwise(kept)]


def _once(points: Sequence[Point]) -> list[Point]:
    """Return points without those that repeat the one before."""
    out = [points[0]]
    for point in points[1:]:
        if math.dist(out[-1], point) > _ALONG_UM:
            out.append(point)
    return out


def _stretch(arc: Arc, low: float, high: float) -> Arc:
    """Return the part of an arc from one angle of its sweep to another."""
    sign = math.copysign(1.0, arc.sweep_rad)
    return replace(
        arc, start_rad=arc.start_rad + sign * low, sweep_rad=sign * (high - low)
    )


def _angle(arc: Arc, point: Point) -> float:
    """Return the angle from an arc's start to a point, along its sweep, [0, 2 pi)."""
    angle = math.atan2(point[1] - arc.center[1], point[0] - arc.center[0])
    turn = (angle - arc.start_rad) * math.copysign(1.0, arc.sweep_rad)
    turn %= math.tau
    return 0.0 if math.tau - turn < JOIN_UM / arc.radius_um else turn


def _frame(line: Segment) -> tuple[complex, float]:
    """Return the unit direction and the length of a segment."""
    along = complex(*line.end) - complex(*line.start)
    return along / abs(along), abs(along)


def _local(line: Segment, along: complex, point: Point) -> complex:
    """Return a point's distance along (real) and across (imaginary) a segment."""
    return (complex(*point) - complex(*line.start)) * along.conjugate()
