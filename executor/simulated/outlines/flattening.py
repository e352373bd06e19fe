"""Polygons of drawn rings, and their offset along normals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import FloatArray

SAGITTA_UM = 0.002  # between an arc and its polygon: a pair errs by less than .005 um
ROUNDED = 1e-5  # share of the largest coordinate: numbers in a file have six digits
MITRE = 2.0  # offsets from a corner that an offset corner may be away, else it is cut

Edges = Sequence[tuple[float, ...]]  # of a WorldRing: 4 numbers a segment, 5 an arc


def polygon(edges: Edges, *, larger: bool) -> FloatArray:
    """Return a closed ring's corners, counter-clockwise, off by SAGITTA_UM at most.

    Parameters
    ----------
    edges : sequence of tuples
        Segments x0, y0, x1, y1 and arcs x, y, radius, start, sweep; um and rad.
    larger : bool
        Whether the polygon contains the drawn region (right for a post); otherwise
        the region contains the polygon (right for a hole). What fits as polygons then
        fits as drawn.

    Returns
    -------
    (N, 2) float array
        Corners, um; what lies nearer together than numbers in a file are exact is one.
    """
    corners = np.concatenate([_points(edge, tangent=False) for edge in edges])
    left = area_um2(corners) > 0
    if any(len(edge) == 5 and ((edge[4] > 0) == left) == larger for edge in edges):
        corners = np.concatenate(
            [
                _points(e, tangent=len(e) == 5 and ((e[4] > 0) == left) == larger)
                for e in edges
            ]
        )
    corners = corners if left else corners[::-1]
    least_um = max(ROUNDED * float(np.abs(corners).max()), 1e-6)
    apart = np.hypot(*(corners - np.roll(corners, 1, axis=0)).T) > least_um
    return np.ascontiguousarray(corners[apart])


def _points(edge: tuple[float, ...], *, tangent: bool) -> FloatArray:
    """Return an edge's points but its last, on its arc or tangents, (N, 2) um."""
    if len(edge) == 4:
        return np.array([edge[:2]])
    if len(edge) != 5:
        raise ValueError(f"an edge has 4 or 5 numbers, got {len(edge)}")
    x, y, radius, start, sweep = edge
    half = math.acos(1 / (1 + SAGITTA_UM / radius))
    count = max(math.ceil(abs(sweep) / (2 * half)), 3)
    turns = start + sweep * np.arange(count) / count
    reach = np.full(count, radius)
    if tangent:
        turns = np.append(turns[0], turns + sweep / (2 * count))
        reach = np.append(radius, reach / math.cos(sweep / (2 * count)))
        if abs(abs(sweep) - math.tau) < ROUNDED:  # a circle has no corner at its start
            turns, reach = turns[1:], reach[1:]
    return np.stack([x + reach * np.cos(turns), y + reach * np.sin(turns)], axis=1)


def area_um2(corners: FloatArray) -> float:
    """Return the signed area of a polygon of (N, 2) um corners, left turns positive."""
    x, y = corners.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def drawn_area_um2(edges: Edges) -> float:
    """Return the signed area of a drawn ring, left turns positive."""
    return area_um2(np.concatenate([_points(edge, tangent=False) for edge in edges]))


def centroid_um(corners: FloatArray) -> tuple[float, float]:
    """Return the centre of area of a polygon of (N, 2) um corners."""
    middle = corners.mean(axis=0)
    near = corners - middle
    after = np.roll(near, -1, axis=0)
    twice = near[:, 0] * after[:, 1] - after[:, 0] * near[:, 1]
    at = middle + (twice[:, None] * (near + after)).sum(axis=0) / (3 * twice.sum())
    return (float(at[0]), float(at[1]))


def offset(corners: FloatArray, by_um: float) -> FloatArray:
    """Return a polygon whose edges lie `by_um` farther out along their normals.

    Corners stay sharp as far as MITRE offsets, beyond it they follow the circle about
    the drawn corner. Edges that an offset consumes are left out.

    Parameters
    ----------
    corners : (N, 2) float array
        Counter-clockwise, um.
    by_um : float
        Positive enlarges the region.

    Returns
    -------
    (M, 2) float array
        Counter-clockwise, um; (0, 2) if nothing is left.
    """
    if by_um == 0:
        return corners
    start, along = corners, _directions(corners)
    while len(start) >= 3:
        made = _mitred(start, along, by_um)
        kept = ((np.roll(made, -1, axis=0) - made) * along).sum(axis=1)
        worst = int(np.argmin(kept))
        if kept[worst] > 0:
            return _cut(start, along, made, by_um)
        start, along = _without(start, along, worst)
    return np.zeros((0, 2))


def _directions(corners: FloatArray) -> FloatArray:
    """Return unit vectors along the edges that begin at (N, 2) um corners, (N, 2)."""
    edges = np.roll(corners, -1, axis=0) - corners
    unit: FloatArray = edges / np.hypot(*edges.T)[:, None]
    return unit


def _mitred(start: FloatArray, along: FloatArray, by_um: float) -> FloatArray:
    """Return where the offset lines of the edges before and after corners meet."""
    after = along[:, ::-1] * (1, -1)  # outward normals: the region lies on the left
    before = np.roll(after, 1, axis=0)
    share = 1 + (after * before).sum(axis=1, keepdims=True)
    made: FloatArray = start + by_um * (after + before) / np.maximum(share, 1e-9)
    return made


def _without(
    start: FloatArray, along: FloatArray, edge: int
) -> tuple[FloatArray, FloatArray]:
    """Return starts and directions with an edge gone, its neighbours lengthened."""
    after = (edge + 1) % len(start)
    d0, d1 = along[edge - 1], along[after]
    turn = float(d0[0] * d1[1] - d0[1] * d1[0])
    gap = start[after] - start[edge]
    meet = (start[edge] + start[after]) / 2
    if abs(turn) > 1e-9:
        share = float(gap[0] * d1[1] - gap[1] * d1[0]) / turn
        meet = start[edge] + share * d0
    start = start.copy()
    start[after] = meet
    return np.delete(start, edge, axis=0), np.delete(along, edge, axis=0)


def _cut(
    start: FloatArray, along: FloatArray, made: FloatArray, by_um: float
) -> FloatArray:
    """Return offset corners with those that run out too far rounded."""
    far = np.hypot(*(made - start).T) > MITRE * abs(by_um)
    before = np.roll(along, 1, axis=0)
    turn = before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0]
    points: list[FloatArray] = []
    for i in range(len(made)):
        if not far[i] or turn[i] * by_um <= 0:
            points.append(made[i : i + 1])
            continue
        pair = np.stack([before[i], along[i]])[:, ::-1] * (1, -1)
        middle = pair.sum(axis=0)
        if (size := float(np.hypot(*middle))) < 1e-9:  # it turns right back
            middle, size = np.asarray(before[i]), 1.0
        round_out = np.stack([pair[0], middle / size, pair[1]])
        points.append(start[i] + by_um * round_out)
    return np.concatenate(points)
