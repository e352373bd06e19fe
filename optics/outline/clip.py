"""Outlines as arrays of edges, cut to a rectangle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import Box, FloatArray
from microplan.optics.outline.outline import Arc, Outline, Segment

# Of radius and position: so near to a side an arc touches it, whatever the rounding.
_TOUCHING = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeArrays:
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

    @property
    def bounds_um(self) -> Box:
        """Return the box around all edges, exact for arcs; there must be an edge."""
        boxes = np.concatenate([self.segments, _arc_bounds(self.arcs)])
        x, y = boxes[:, 0::2], boxes[:, 1::2]
        return (float(x.min()), float(y.min()), float(x.max()), float(y.max()))


def to_edges(outline: Outline) -> EdgeArrays:
    """Return the edges of `outline` as they are."""
    edges = [edge for ring in outline.rings for edge in ring.edges]
    segments = [(*e.start, *e.end) for e in edges if isinstance(e, Segment)]
    arcs = [
        (*e.center, e.radius_um, e.start_rad, e.sweep_rad)
        for e in edges
        if isinstance(e, Arc)
    ]
    return EdgeArrays(
        segments=np.array(segments, dtype=np.float64).reshape(-1, 4),
        arcs=np.array(arcs, dtype=np.float64).reshape(-1, 5),
    )


def grown(box: Box, by_um: float) -> Box:
    """Return a box with `by_um` more on every side."""
    return (box[0] - by_um, box[1] - by_um, box[2] + by_um, box[3] + by_um)


def common(one: Box, other: Box) -> Box:
    """Return the common part of two boxes that overlap."""
    return (
        max(one[0], other[0]),
        max(one[1], other[1]),
        min(one[2], other[2]),
        min(one[3], other[3]),
    )


def clip(outline: Outline | EdgeArrays, box: Box) -> EdgeArrays:
    """Return the edges of an outline cut to a rectangle.

    Parameters
    ----------
    box : (x_min, y_min, x_max, y_max)
        The rectangle, um.

    Returns
    -------
    EdgeArrays
        Closed rings again, with new edges along the box where it cuts; what is left
        of an arc is an arc.

    Notes
    -----
    Every edge is split where it meets a side's line, and what lies beyond a side is
    moved onto it. No point of a ring crosses the inside of the box on its path there,
    so windings about points inside stay, and double edges along the box cancel in
    every boundary integral, as after Sutherland & Hodgman (1974), Commun. ACM 17, 32.
    """
    edges = outline if isinstance(outline, EdgeArrays) else to_edges(outline)
    if not len(edges.arcs):
        return EdgeArrays(segments=_lines_clipped(edges.segments, box), arcs=edges.arcs)
    bounds = _arc_bounds(edges.arcs)
    inside, beyond = _within(bounds, box), _beyond(bounds, box)
    split = [_split(arc, box) for arc in edges.arcs[~inside & ~beyond]]
    return EdgeArrays(
        segments=np.concatenate(
            [
                _lines_clipped(edges.segments, box),
                _moved(edges.arcs[beyond], box),
                *(s for s, _ in split),
            ]
        ),
        arcs=np.concatenate([edges.arcs[inside], *(a for _, a in split)]),
    )


def _lines_clipped(segments: FloatArray, box: Box) -> FloatArray:
    """Return segments (S, 4) as `clip` leaves them, those inside first."""
    first, last = segments[:, :2], segments[:, 2:]
    bounds = np.concatenate([np.minimum(first, last), np.maximum(first, last)], axis=1)
    whole = _within(bounds, box)
    if whole.all():
        return segments
    return np.concatenate([segments[whole], _cut(segments[~whole], box)])


def _moved(arcs: FloatArray, box: Box) -> FloatArray:
    """Return segments along the box for arcs (M, 5) that lie beyond one side, (N, 4).

    All of such an arc is moved onto that side's line, where only its ends count.
    """
    center, radius, start, sweep = arcs[:, :2], arcs[:, 2:3], arcs[:, 3], arcs[:, 4]
    low, high = np.array(box[:2]), np.array(box[2:])
    ends = [
        np.clip(center + radius * _directions(angle), low, high)
        for angle in (start, start + sweep)
    ]
    along = np.concatenate(ends, axis=1)
    moved: FloatArray = along[(ends[0] != ends[1]).any(axis=1)]
    return moved


def _split(arc: FloatArray, box: Box) -> tuple[FloatArray, FloatArray]:
    """Split an arc (5,) at the sides' lines, move what lies beyond onto the box.

    Returns
    -------
    (N, 4) and (M, 5) float64 array
        Segments along the box, and the arcs inside.
    """
    center, radius = arc[:2], float(arc[2])
    low, high = np.array(box[:2]), np.array(box[2:])
    angles = _crossings(arc, np.stack([low, high], axis=1))
    points = center + radius * _directions(angles)
    middles = center + radius * _directions((angles[:-1] + angles[1:]) / 2)
    room = _TOUCHING * (radius + float(np.abs(center).sum()))
    held = ((middles >= low - room) & (middles <= high + room)).all(axis=1)
    swept = np.diff(angles)
    onto = np.clip(points, low, high)
    along = np.concatenate([onto[:-1], onto[1:]], axis=1)[~held]
    moved = along[(along[:, :2] != along[:, 2:]).any(axis=1)]
    # an arc that starts on a side's line meets it at once
    left = np.column_stack([angles[:-1], swept])[held & (swept != 0)]
    body = np.broadcast_to(arc[:3], (len(left), 3))
    return moved, np.concatenate([body, left], axis=1)


def _crossings(arc: FloatArray, sides: FloatArray) -> FloatArray:
    """Return the angles at which an arc starts, meets the sides' lines, and ends.

    `sides` are the positions of two lines across x, and of two across y, (2, 2) um.
    """
    radius, start, sweep = (float(value) for value in arc[2:])
    share = (sides - arc[:2, None]) / radius
    meets = np.abs(share) < 1
    half = np.arccos(share[meets])
    quarter = np.repeat([0.0, np.pi / 2], meets.sum(axis=1))
    turns = np.concatenate([quarter - half, quarter + half])
    along = np.mod(math.copysign(1.0, sweep) * (turns - start), 2 * np.pi)
    inner = np.sort(along[along < abs(sweep)]) / abs(sweep)
    return start + sweep * np.concatenate([[0.0], inner, [1.0]])


def _directions(angles: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _cut(segments: FloatArray, box: Box) -> FloatArray:
    """Split segments at the sides' lines, move what lies beyond onto the box."""
    start, step = segments[:, None, :2], segments[:, None, 2:] - segments[:, None, :2]
    low, high = np.array(box[:2]), np.array(box[2:])
    sides = np.concatenate([low - start, high - start], axis=1)  # (S, 2, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (sides / step).reshape(len(segments), 4)
    at = np.clip(np.where(np.isfinite(at), at, 0.0), 0.0, 1.0)
    ends = np.broadcast_to([0.0, 1.0], (len(segments), 2))
    at = np.sort(np.concatenate([ends, at], axis=1), axis=1)
    points = np.clip(start + at[:, :, None] * step, low, high)  # (S, 6, 2)
    points[:, -1] = np.clip(segments[:, 2:], low, high)  # without rounding
    pieces = np.concatenate([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 4)
    moved: FloatArray = pieces[(pieces[:, :2] != pieces[:, 2:]).any(axis=1)]
    return moved


def _arc_bounds(arcs: FloatArray) -> FloatArray:
    """Return the boxes around arcs, (M, 4) um."""
    cx, cy, radius, start, sweep = arcs.T
    low, high = np.minimum(start, start + sweep), np.maximum(start, start + sweep)
    bounds = np.empty((len(arcs), 4))
    across, up = (np.cos(low), np.cos(high)), (np.sin(low), np.sin(high))
    for column, (center, ends, quarter, sign) in enumerate(
        ((cx, across, 2, -1), (cy, up, 3, -1), (cx, across, 0, 1), (cy, up, 1, 1))
    ):
        turn = quarter * np.pi / 2  # where a circle reaches farthest
        first = low + np.mod(turn - low, 2 * np.pi)
        farther = np.maximum if sign > 0 else np.minimum
        far = np.where(first <= high, float(sign), farther(*ends))
        bounds[:, column] = center + radius * far
    return bounds


def _within(bounds: FloatArray, box: Box) -> npt.NDArray[np.bool_]:
    """Tell which boxes (N, 4) lie in `box`, (N,)."""
    low, high = np.array(box[:2]), np.array(box[2:])
    held = np.concatenate([bounds[:, :2] >= low, bounds[:, 2:] <= high], axis=1)
    return np.asarray(held.all(axis=1))


def _beyond(bounds: FloatArray, box: Box) -> npt.NDArray[np.bool_]:
    """Tell which boxes (N, 4) lie on the far side of one side's line of `box`, (N,)."""
    low, high = np.array(box[:2]), np.array(box[2:])
    out = np.concatenate([bounds[:, 2:] <= low, bounds[:, :2] >= high], axis=1)
    return np.asarray(out.any(axis=1))
