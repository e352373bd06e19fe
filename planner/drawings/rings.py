"""Closed rings chained from loose edges, in one canonical form."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from microplan.arrays import Point
from microplan.optics.outline.outline import JOIN_UM, Arc, Edge, Ring, Segment
from microplan.optics.outline.tolerant_order import least
from microplan.planner.drawings.pieces import Piece

GAP_UM = 0.01  # wider gaps are not closed; real drawings' gaps are below 10 nm
_CROWD = 16  # ends within 10 nm of each other
_BETWEEN = math.e / 10  # of a nanometre
SAME_UM = 1e-5  # centres and radii closer than this belong to one circle


@dataclass(frozen=True, slots=True)
class OpenEnd:
    """A loose end: where it is and which entity it belongs to."""

    x_um: float
    y_um: float
    handle: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Chained:
    """What chaining found; rings are usable if `open` and `branches` are empty."""

    rings: tuple[Ring, ...]
    handles: tuple[tuple[str, ...], ...]  # of the entities of each ring, in order
    open: tuple[OpenEnd, ...]
    branches: tuple[OpenEnd, ...]  # ends at points where more than two edges meet
    gaps_um: tuple[float, ...]  # those bridged by a straight edge
    doubled: tuple[str, ...]  # handles of edges drawn a second time


@dataclass(frozen=True, slots=True)
class _End:
    piece: int
    last: bool
    point: Point


def chain(pieces: Sequence[Piece]) -> Chained:
    """Return the rings that `pieces` form; nothing is guessed where they branch."""
    kept, doubled = _without_doubles(pieces)
    loose = [piece for piece in kept if not piece.closed]
    mates, branches, lonely = _pair(_ends(loose))
    paths = [[piece] for piece in kept if piece.closed]
    if not (branches or lonely):
        paths += _walk(loose, mates)
    torn = [place for piece in kept for place in _torn(piece)]
    rings: list[Ring] = []
    gaps: list[float] = []
    for path in paths:
        edges = _bridged([edge for piece in path for edge in piece.edges], gaps)
        layer = _layer(path)
        rings.append(canonical(Ring(edges=edges, layer=layer)))
    return Chained(
        rings=tuple(rings),
        handles=tuple(tuple(dict.fromkeys(p.handle for p in path)) for path in paths),
        open=(*(_open(loose, end) for end in lonely), *torn),
        branches=tuple(_open(loose, end) for end in branches),
        gaps_um=tuple(gaps),
        doubled=doubled,
    )


def _layer(path: Sequence[Piece]) -> str:
    """Return the layer that most of a path is on, the first by name of several."""
    return least(sorted({p.layer for p in path}), lambda name: -_share(path, name))


def canonical(ring: Ring) -> Ring:
    """Return the same ring counter-clockwise, pieces of one line or arc merged.

    The first edge is the one with the lowest starting point, so that neither the order
    nor the direction in which a ring was drawn matters.
    """
    if ring.signed_area_um2 < 0:
        ring = ring.reversed()
    edges = _merged(ring.edges)
    if len(edges) == 1 and isinstance(arc := edges[0], Arc):
        edges = [replace(arc, start_rad=0.0, sweep_rad=math.tau)]
    edges = [_one_turn(edge) for edge in edges]
    first = min(range(len(edges)), key=lambda i: rounded(edges[i].start))
    return Ring(edges=tuple(edges[first:] + edges[:first]), layer=ring.layer)


def _one_turn(edge: Edge) -> Edge:
    """Return an arc with its start in (-pi, pi]; rounding may not flip the seam."""
    if isinstance(edge, Segment):
        return edge
    start_rad = math.remainder(edge.start_rad, math.tau)
    if start_rad < 1e-9 - math.pi:
        start_rad += math.tau
    return replace(edge, start_rad=start_rad)


def same_circle(a: Arc, b: Arc, within_um: float = SAME_UM) -> bool:
    """Return whether two arcs lie on one circle."""
    return (
        math.dist(a.center, b.center) <= within_um
        and abs(a.radius_um - b.radius_um) <= within_um
    )


def edges_key(edges: Sequence[Edge]) -> frozenset[object]:
    """Return what two drawings of the same edges have in common, to 1 nm."""
    return frozenset(edge_key(edge) for edge in edges)


def cell(value_um: float) -> int:
    """Return in which nanometre a length lies.

    Borders lie at no decimal fraction: what was written as one, in whatever unit, does
    not change its cell by the last bit.
    """
    return math.floor(value_um * 1e3 + _BETWEEN)


def rounded(point: Point) -> tuple[int, int]:
    """Return in which square nanometre a point lies."""
    return cell(point[0]), cell(point[1])


def edge_key(edge: Edge) -> object:
    """Return what two drawings of one edge have in common."""
    ends = frozenset((rounded(edge.start), rounded(edge.end)))
    if isinstance(edge, Segment):
        return ends
    middle = edge.center if edge.is_circle else edge.at(0.5)
    return (ends if not edge.is_circle else edge.is_circle, rounded(middle),
            cell(edge.radius_um))  # fmt: skip


def _without_doubles(
    pieces: Sequence[Piece],
) -> tuple[list[Piece], tuple[str, ...]]:
    """Return the pieces drawn once, and the handles of repetitions."""
    kept: dict[object, Piece] = {}
    doubled = []
    for piece in pieces:
        key = edges_key(piece.edges)
        if key in kept:
            doubled.append(piece.handle)
        else:
            kept[key] = piece
    return list(kept.values()), tuple(doubled)


def _ends(loose: Sequence[Piece]) -> list[_End]:
    ends = []
    for index, piece in enumerate(loose):
        ends.append(_End(index, False, piece.edges[0].start))  # noqa: FBT003
        ends.append(_End(index, True, piece.edges[-1].end))  # noqa: FBT003
    return ends


def _pair(ends: list[_End]) -> tuple[dict[_End, _End], list[_End], list[_End]]:
    """Return who joins whom, ends where more than two meet, and ends left alone.

    Coinciding ends go first; only what is then left over may bridge a gap, nearest
    first.
    """
    near = sorted(_near(ends))
    meeting: dict[_End, int] = {}
    for gap, i, j in near:
        if gap <= JOIN_UM:
            meeting[ends[i]] = meeting.get(ends[i], 0) + 1
            meeting[ends[j]] = meeting.get(ends[j], 0) + 1
    branches = [end for end in ends if meeting.get(end, 0) > 1]
    mates: dict[_End, _End] = {}
    for _, i, j in near:
        a, b = ends[i], ends[j]
        if a not in mates and b not in mates:
            mates[a], mates[b] = b, a
    return mates, branches, [end for end in ends if end not in mates]


def _near(ends: Sequence[_End]) -> Iterable[tuple[float, int, int]]:
    """Yield (distance, i, j) of ends within GAP_UM, by a grid of that size.

    Of a crowd only the first are compared with: it is refused in any case.
    """
    cells: dict[tuple[int, int], list[int]] = {}
    for j, end in enumerate(ends):
        column = math.floor(end.point[0] / GAP_UM)
        row = math.floor(end.point[1] / GAP_UM)
        for cell in ((column + dx, row + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)):
            for i in cells.get(cell, ()):
                gap = math.dist(ends[i].point, end.point)
                if gap <= GAP_UM:
                    yield gap, i, j
        here = cells.setdefault((column, row), [])
        if len(here) < _CROWD:
            here.append(j)


def _walk(loose: Sequence[Piece], mates: dict[_End, _End]) -> list[list[Piece]]:
    """Return closed paths of pieces with one direction each; every end has a mate."""
    starts = {(end.piece, end.last): end for end in mates}
    paths, seen = [], set()
    for first in range(len(loose)):
        if first in seen:
            continue
        path: list[Piece] = []
        index, forward = first, True
        while index not in seen:
            seen.add(index)
            piece = loose[index]
            path.append(piece if forward else _backwards(piece))
            mate = mates[starts[index, forward]]
            index, forward = mate.piece, not mate.last
        paths.append(path)
    return paths


def _backwards(piece: Piece) -> Piece:
    """Return a piece run from its end to its start."""
    return replace(piece, edges=tuple(_turned(edge) for edge in piece.edges[::-1]))


def _turned(edge: Edge) -> Edge:
    """Return the edge with its direction reversed."""
    if isinstance(edge, Segment):
        return Segment(start=edge.end, end=edge.start)
    end_rad = edge.start_rad + edge.sweep_rad
    return replace(edge, start_rad=end_rad, sweep_rad=-edge.sweep_rad)


def _bridged(edges: Sequence[Edge], gaps: list[float]) -> tuple[Edge, ...]:
    """Return `edges` with straight bridges over gaps that a ring may not have."""
    out: list[Edge] = []
    for edge, after in zip(edges, [*edges[1:], edges[0]], strict=True):
        out.append(edge)
        gap = math.dist(edge.end, after.start)
        if gap > JOIN_UM:
            gaps.append(gap)
            out.append(Segment(start=edge.end, end=after.start))
    return tuple(out)


def _torn(piece: Piece) -> Iterator[OpenEnd]:
    """Yield where a piece by itself has a gap that is too wide, as a spline may."""
    after = (*piece.edges[1:], *(piece.edges[:1] if piece.closed else ()))
    for a, b in zip(piece.edges, after, strict=False):
        if math.dist(a.end, b.start) > GAP_UM:
            yield OpenEnd(*a.end, piece.handle)
            yield OpenEnd(*b.start, piece.handle)


def _share(path: Sequence[Piece], layer: str) -> float:
    """Return the length of a path's edges on `layer`."""
    return sum(e.length_um for p in path if p.layer == layer for e in p.edges)


def _open(loose: Sequence[Piece], end: _End) -> OpenEnd:
    return OpenEnd(end.point[0], end.point[1], loose[end.piece].handle)


def _merged(edges: Sequence[Edge]) -> list[Edge]:
    """Join neighbours that continue one line or one circle, also over the seam."""
    out: list[Edge] = []
    for edge in edges:
        joined = _joined(out[-1], edge) if out else None
        if joined is None:
            out.append(edge)
        else:
            out[-1] = joined
    while len(out) > 1 and (joined := _joined(out[-1], out[0])) is not None:
        out = [joined, *out[1:-1]]
    return out


def _joined(a: Edge, b: Edge) -> Edge | None:
    """Return `a` and `b` as one edge, None if they are two."""
    if isinstance(a, Arc) and isinstance(b, Arc):
        if a.sweep_rad * b.sweep_rad < 0 or not same_circle(a, b):
            return None
        gap = math.remainder(b.start_rad - a.start_rad - a.sweep_rad, math.tau)
        sweep = a.sweep_rad + gap + b.sweep_rad
        if (abs(sweep) - math.tau) * a.radius_um > JOIN_UM:
            return None  # one runs over the other: no circle, whatever they are
        if abs(sweep) > math.tau - 1e-9:  # both are needed only to close the circle
            return replace(a, sweep_rad=math.copysign(math.tau, sweep))
        return replace(a, sweep_rad=sweep)
    if isinstance(a, Segment) and isinstance(b, Segment):
        whole = Segment(start=a.start, end=b.end)
        if _off_line(whole, a.end) <= SAME_UM and (
            a.length_um + b.length_um - whole.length_um <= SAME_UM
        ):
            return whole
    return None


def _off_line(line: Segment, point: Point) -> float:
    """Return the distance of `point` from the line through `line`, um."""
    (x0, y0), (x1, y1) = line.start, line.end
    if not line.length_um:
        return math.inf
    cross = (x1 - x0) * (point[1] - y0) - (y1 - y0) * (point[0] - x0)
    return abs(cross) / line.length_um
