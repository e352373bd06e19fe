"""Outlines as arrays of edges, cut to a rectangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from optics.outline import Arc, Edge, Outline, Ring, Segment, edge_bounds, flatten

FloatArray = npt.NDArray[np.float64]
Box = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max, um

# Arcs that cross the box become chords with this sagitta: a thousandth of a pixel.
CHORD_UM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """The edges of closed rings, in no particular order, um and rad."""

    segments: FloatArray  # (S, 4) x0, y0, x1, y1
    arcs: FloatArray  # (M, 5) center x, center y, radius, start, sweep

    @property
    def area_um2(self) -> float:
        """Return the enclosed area, holes taken off."""
        x0, y0, x1, y1 = self.segments.T
        cx, cy, r, a, s = self.arcs.T
        b = a + s
        swept = r * (cx * (np.sin(b) - np.sin(a)) - cy * (np.cos(b) - np.cos(a)))
        return float((x0 * y1 - x1 * y0).sum() / 2 + (swept + r**2 * s).sum() / 2)


def to_edges(outline: Outline) -> Edges:
    """Return the edges of `outline` as they are."""
    return _pack([edge for ring in outline.rings for edge in ring.edges])


def clip(outline: Outline, box: Box) -> Edges:
    """Return the edges of `outline` cut to a rectangle.

    Parameters
    ----------
    outline : Outline
        Closed rings, um.
    box : (x_min, y_min, x_max, y_max)
        The rectangle, um.

    Returns
    -------
    Edges
        Closed rings again, with new edges along the box where it cuts. Arcs wholly
        inside stay arcs; one that reaches over the box becomes chords of `CHORD_UM`
        sagitta.

    References
    ----------
    Sutherland & Hodgman (1974), Commun. ACM 17, 32. Their double edges along the
    box cancel in every boundary integral.
    """
    segments, arcs = [], []
    for ring in outline.rings:
        part = _clip_ring(ring, box)
        segments.append(part.segments)
        arcs.append(part.arcs)
    return Edges(
        segments=np.concatenate([np.empty((0, 4)), *segments]),
        arcs=np.concatenate([np.empty((0, 5)), *arcs]),
    )


def _clip_ring(ring: Ring, box: Box) -> Edges:
    """Cut one ring."""
    bounds = [edge_bounds(edge) for edge in ring.edges]
    if all(_within(b, box) for b in bounds):
        return _pack(list(ring.edges))
    points, kinds, arcs = _corners(ring, bounds, box)
    for axis, limit, sign in ((0, 0, 1), (1, 1, 1), (0, 2, -1), (1, 3, -1)):
        points, kinds = _cut(points, kinds, axis, box[limit], sign)
    straight = kinds < 0
    after = np.roll(points, -1, axis=0)
    return Edges(
        segments=np.concatenate([points, after], axis=1)[straight],
        arcs=arcs[kinds[~straight]],
    )


def _corners(
    ring: Ring, bounds: list[Box], box: Box
) -> tuple[FloatArray, npt.NDArray[np.intp], FloatArray]:
    """Return corners (N, 2), the arc that leaves each (N,) or -1, the arcs (M, 5)."""
    points: list[FloatArray] = []
    kinds: list[npt.NDArray[np.intp]] = []
    for index, (edge, bound) in enumerate(zip(ring.edges, bounds, strict=True)):
        if isinstance(edge, Arc) and not _within(bound, box):
            chords = _chord_points(edge)
            points.append(chords)
            kinds.append(np.full(len(chords), -1))
        else:
            points.append(np.array([edge.start]))
            kinds.append(np.array([index if isinstance(edge, Arc) else -1]))
    arcs = np.array([_row(edge) for edge in ring.edges])
    return np.concatenate(points), np.concatenate(kinds), arcs


def _chord_points(arc: Arc) -> FloatArray:
    """Return the corners of an arc's chords but the last, (N, 2) um."""
    back = Segment(start=arc.end, end=arc.start)
    edges: tuple[Edge, ...] = (arc,) if arc.is_circle else (arc, back)
    points = flatten(Ring(edges=edges), CHORD_UM)
    return points if arc.is_circle else points[:-1]


def _cut(
    points: FloatArray,
    kinds: npt.NDArray[np.intp],
    axis: int,
    limit_um: float,
    sign: int,
) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Keep what lies at sign * (coordinate - limit) >= 0."""
    if not len(points):
        return points, kinds
    side = sign * (points[:, axis] - limit_um)
    inside = side >= 0
    if inside.all():
        return points, kinds
    crosses = inside != np.roll(inside, -1)
    step = np.roll(points, -1, axis=0) - points
    share = np.where(crosses, side / np.where(crosses, side - np.roll(side, -1), 1), 0)
    crossing = points + share[:, None] * step
    crossing[:, axis] = limit_um
    both = np.stack([points, crossing], axis=1).reshape(-1, 2)
    kind = np.stack([kinds, np.full_like(kinds, -1)], axis=1).ravel()
    keep = np.stack([inside, crosses], axis=1).ravel()
    return both[keep], kind[keep]


def _within(bounds: Box, box: Box) -> bool:
    """Tell whether `bounds` lies in `box`."""
    return (
        bounds[0] >= box[0]
        and bounds[1] >= box[1]
        and bounds[2] <= box[2]
        and bounds[3] <= box[3]
    )


def _row(edge: Edge) -> tuple[float, ...]:
    """Return an arc's numbers, zeros for a segment."""
    if isinstance(edge, Segment):
        return (0.0,) * 5
    return (*edge.center, edge.radius_um, edge.start_rad, edge.sweep_rad)


def _pack(edges: list[Edge]) -> Edges:
    """Sort edges into the two arrays."""
    segments = [(*e.start, *e.end) for e in edges if isinstance(e, Segment)]
    arcs = [_row(e) for e in edges if isinstance(e, Arc)]
    return Edges(
        segments=np.array(segments, dtype=np.float64).reshape(-1, 4),
        arcs=np.array(arcs, dtype=np.float64).reshape(-1, 5),
    )
