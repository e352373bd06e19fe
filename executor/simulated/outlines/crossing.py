"""Polygons against polygons: points inside, boundaries that cross."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.schemas.pose import Pose

PAIRS = 100_000  # of edges looked at together: some MB


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
    x, y = points[:, :1], points[:, 1:]
    x0, y0 = ring.T
    x1, y1 = np.roll(x0, -1), np.roll(y0, -1)
    side = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
    up = (y0 <= y) & (y < y1) & (side > 0)
    down = (y1 <= y) & (y < y0) & (side < 0)
    inside: npt.NDArray[np.bool_] = np.count_nonzero(up, axis=1) > np.count_nonzero(
        down, axis=1
    )
    return inside


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
    at_once = max(1, PAIRS // max(len(second), 1))
    return any(
        _cross(first[i : i + at_once], second) for i in range(0, len(first), at_once)
    )


def _cross(first: FloatArray, second: FloatArray) -> bool:
    """Return whether segments meet; one that touches another meets it."""
    p, r = first[:, None, 0], first[:, None, 1] - first[:, None, 0]
    q, s = second[None, :, 0], second[None, :, 1] - second[None, :, 0]
    gap_x, gap_y = q[..., 0] - p[..., 0], q[..., 1] - p[..., 1]
    turn = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    of_first = gap_x * s[..., 1] - gap_y * s[..., 0]  # places, times `turn`
    of_second = gap_x * r[..., 1] - gap_y * r[..., 0]
    size, sign = np.abs(turn), np.where(turn < 0, -1.0, 1.0)
    of_first, of_second = sign * of_first, sign * of_second
    meet = (of_first >= 0) & (of_first <= size) & (of_second >= 0) & (of_second <= size)
    if not meet.any():
        return False
    i, j = np.nonzero(meet)
    low = np.maximum(first[i].min(axis=1), second[j].min(axis=1))
    high = np.minimum(first[i].max(axis=1), second[j].max(axis=1))
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
