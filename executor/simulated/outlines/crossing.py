"""Polygons against polygons: points inside, boundaries that cross."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.schemas.pose import Pose

PAIRS = 100_000  # of edges looked at together: some MB
TALL = 8.0  # times the median's height: what reaches past many others goes apart

IntArray = npt.NDArray[np.intp]


def moved(points: FloatArray, pose: Pose) -> FloatArray:
    """Rotate, then shift; (N, 2) um to (N, 2) um."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    turn = np.array([[c, s], [-s, c]])
    there: FloatArray = points @ turn + np.array([pose.x_um, pose.y_um])
    return there


def enclosed(points: FloatArray, ring: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which (N, 2) um points a left-turning (M, 2) um ring goes around, (N,).

    By winding number: a piece that an offset turned inside out is no inside.
    """
    (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    order = np.argsort(points[:, 1])
    heights = points[order, 1]
    first = np.searchsorted(heights, np.minimum(y0, y1))
    after = np.searchsorted(heights, np.maximum(y0, y1))  # a corner counts once
    edge, place = _ranges(first, after)
    point = order[place]
    x, y = points[point].T
    side = (x1 - x0)[edge] * (y - y0[edge]) - (x - x0[edge]) * (y1 - y0)[edge]
    up = y1[edge] > y0[edge]
    turns = np.where(up & (side > 0), 1, 0) - np.where(~up & (side < 0), 1, 0)
    inside: npt.NDArray[np.bool_] = np.bincount(point, turns, len(points)) > 0.5
    return inside


def _ranges(first: IntArray, after: IntArray) -> tuple[IntArray, IntArray]:
    """Return all (i, j) with first[i] <= j < after[i], as two arrays."""
    count = np.maximum(after - first, 0)
    i = np.repeat(np.arange(len(first)), count)
    return i, np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)


def distances_um(points: FloatArray, ring: FloatArray) -> FloatArray:
    """Return how far (N, 2) um points lie from a ring of (M, 2) um corners, (N,) um."""
    if not len(points):
        return np.zeros(0)
    at_once = max(1, PAIRS // len(ring))
    parts = (points[i : i + at_once] for i in range(0, len(points), at_once))
    return np.concatenate([edge_distances_um(part, ring).min(axis=1) for part in parts])


def edge_distances_um(points: FloatArray, ring: FloatArray) -> FloatArray:
    """Return how far (N, 2) um points lie from each of M edges, (N, M) um."""
    (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    dx, dy = x1 - x0, y1 - y0
    x, y = points[:, :1] - x0, points[:, 1:] - y0
    share = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0, 1)
    far: FloatArray = np.hypot(x - share * dx, y - share * dy)
    return far


def segments(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring of (N, 2) um corners, (N, 2, 2) um."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def cross(first: FloatArray, second: FloatArray) -> bool:
    """Return whether any (N, 2, 2) um segment meets any (M, 2, 2) um one."""
    for a, b in ((0, 1), (1, 0)):
        both = (first, second)
        if not len(both[a]) or not len(both[b]):
            return False
        box = both[b].min(axis=(0, 1)), both[b].max(axis=(0, 1))
        near = (both[a].max(axis=1) >= box[0]) & (both[a].min(axis=1) <= box[1])
        chosen = both[a][near.all(axis=1)]
        first, second = (chosen, second) if a == 0 else (first, chosen)
    if not len(first) or not len(second):
        return False
    size = np.ptp(second[..., 1], axis=1)
    tall = size > TALL * np.median(size)
    return _cross(first, second[tall]) or _cross(first, second[~tall])


def _cross(first: FloatArray, second: FloatArray) -> bool:
    """Return whether segments meet; the second ones are about equally tall."""
    if not len(second):
        return False
    second = second[np.argsort(second[..., 1].min(axis=1))]
    low = second[..., 1].min(axis=1)
    high = np.maximum.accumulate(second[..., 1].max(axis=1))
    begin = np.searchsorted(high, first[..., 1].min(axis=1))
    end = np.searchsorted(low, first[..., 1].max(axis=1), side="right")
    at_once = max(1, PAIRS // len(second))
    for k in range(0, len(first), at_once):
        i, j = _ranges(begin[k : k + at_once], end[k : k + at_once])
        if len(i) and _meet(first[k + i], second[j]):
            return True
    return False


def _meet(first: FloatArray, second: FloatArray) -> bool:
    """Return whether any of K pairs of (K, 2, 2) um segments meets, or touches."""
    (px, py), (rx, ry) = first[:, 0].T, (first[:, 1] - first[:, 0]).T
    (qx, qy), (sx, sy) = second[:, 0].T, (second[:, 1] - second[:, 0]).T
    gap_x, gap_y = qx - px, qy - py
    turn = rx * sy - ry * sx
    sign, size = np.where(turn < 0, -1.0, 1.0), np.abs(turn)
    of_first = sign * (gap_x * sy - gap_y * sx)  # places on the segments, times size
    of_second = sign * (gap_x * ry - gap_y * rx)
    meet = (of_first >= 0) & (of_first <= size) & (of_second >= 0) & (of_second <= size)
    if not meet.any():
        return False
    low = np.maximum(first[meet].min(axis=1), second[meet].min(axis=1))
    high = np.minimum(first[meet].max(axis=1), second[meet].max(axis=1))
    return bool((low <= high).all(axis=1).any())  # parallel ones may lie far apart


def share_area(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> bool:
    """Return whether two regions share area, or touch.

    Each is the even-odd region of its left-turning (N, 2) um rings. Where no edges
    meet, a ring lies wholly in the other region or wholly out of it.
    """
    edges = [np.concatenate([segments(r) for r in rings]) for rings in (first, second)]
    return cross(*edges) or _within(first, second) or _within(second, first)


def _within(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> bool:
    """Return whether any of the first rings begins in the second ones' region."""
    starts = np.stack([ring[0] for ring in first])
    depth = sum(enclosed(starts, ring).astype(int) for ring in second)
    return bool((np.asarray(depth) % 2 == 1).any())
