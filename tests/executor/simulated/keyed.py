"""Outlines of pegs and holes with their regions in closed form.

Rings are drawn as in world.json; a region answers for points, without any polygon.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

Drawn = tuple[tuple[float, ...], ...]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Keyed:
    """A closed outline: its edges, and which points (x, y) it holds when grown."""

    edges: Drawn
    holds: Callable[[FloatArray, FloatArray, float], Bools]  # x, y, grown by um


def circle(radius: float) -> Keyed:
    """Return a circle."""
    return Keyed(
        edges=((0.0, 0.0, radius, 0.0, math.tau),),
        holds=lambda x, y, by: np.hypot(x, y) <= radius + by,
    )


def d_shape(radius: float, flat: float) -> Keyed:
    """Return a circle with a flat at x = `flat`."""
    half = math.acos(flat / radius)
    y = radius * math.sin(half)
    return Keyed(
        edges=((0.0, 0.0, radius, half, math.tau - 2 * half), (flat, -y, flat, y)),
        holds=lambda x, y, by: (np.hypot(x, y) <= radius + by) & (x <= flat + by),
    )


def rectangle(width: float, height: float) -> Keyed:
    """Return a rectangle about the origin."""
    x, y = width / 2, height / 2
    return Keyed(
        edges=polyline([(-x, -y), (x, -y), (x, y), (-x, y)]),
        holds=lambda u, v, by: (np.abs(u) <= x + by) & (np.abs(v) <= y + by),
    )


def cross(length: float, width: float) -> Keyed:
    """Return a cross of arms up to `length` from the centre, `width` wide."""
    a, b = length, width / 2
    corners = [(a, -b), (a, b), (b, b), (b, a), (-b, a), (-b, b)]
    corners += [(-x, -y) for x, y in corners]
    return Keyed(
        edges=polyline(corners),
        holds=lambda x, y, by: (
            (np.abs(x) <= a + by) & (np.abs(y) <= b + by)
            | (np.abs(x) <= b + by) & (np.abs(y) <= a + by)
        ),
    )


def slot(length: float, radius: float) -> Keyed:
    """Return a slot: all within `radius` of a line of `length` along x."""
    a, r = length / 2, radius
    return Keyed(
        edges=(
            (-a, -r, a, -r),
            (a, 0.0, r, -math.pi / 2, math.pi),
            (a, r, -a, r),
            (-a, 0.0, r, math.pi / 2, math.pi),
        ),
        holds=lambda x, y, by: np.hypot(x - np.clip(x, -a, a), y) <= r + by,
    )


def spline(teeth: int, root: float, tip: float, width: float) -> Keyed:
    """Return a circle with `teeth` straight teeth outwards; one is a keyway or key."""
    b = width / 2
    half = math.asin(b / root)
    edges: list[tuple[float, ...]] = []
    for i in range(teeth):
        turn, pitch = math.tau * i / teeth, math.tau / teeth
        foot, end = (root * math.cos(half), b), (tip, b)
        corners = [_turned(x, s * y, turn) for x, y, s in
                   [(*foot, -1), (*end, -1), (*end, 1), (*foot, 1)]]  # fmt: skip
        edges += [(*p, *q) for p, q in pairwise(corners)]
        edges.append((0.0, 0.0, root, turn + half, pitch - 2 * half))

    def holds(x: FloatArray, y: FloatArray, by: float) -> Bools:
        found = np.hypot(x, y) <= root + by
        for i in range(teeth):
            c, s = math.cos(math.tau * i / teeth), math.sin(math.tau * i / teeth)
            u, v = c * x + s * y, c * y - s * x
            found |= (u >= 0) & (u <= tip + by) & (np.abs(v) <= b + by)
        return found

    return Keyed(edges=tuple(edges), holds=holds)


def bore_with_key(radius: float, inner: float, width: float) -> Keyed:
    """Return a bore with a key that reaches inwards to x = `inner`."""
    b = width / 2
    half = math.asin(b / radius)
    x = radius * math.cos(half)
    return Keyed(
        edges=(
            (0.0, 0.0, radius, half, math.tau - 2 * half),
            *polyline([(x, -b), (inner, -b), (inner, b), (x, b)])[:3],
        ),
        holds=lambda x, y, by: (
            (np.hypot(x, y) <= radius + by) & ~((x > inner + by) & (np.abs(y) < b - by))
        ),
    )


def post_with_groove(radius: float, inner: float, width: float) -> Keyed:
    """Return a post with a groove down to x = `inner`, for a bore with a key."""
    return bore_with_key(radius, inner, width)


def polyline(corners: Sequence[tuple[float, float]]) -> Drawn:
    """Return a closed ring of segments."""
    ends = [*corners[1:], corners[0]]
    return tuple((*a, *b) for a, b in zip(corners, ends, strict=True))


def as_hole(edges: Drawn) -> Drawn:
    """Return a ring in the other sense, as world.json has it for holes."""
    return tuple(
        (*e[2:], *e[:2]) if len(e) == 4 else (*e[:3], e[3] + e[4], -e[4])
        for e in reversed(edges)
    )


def rim(edges: Drawn, spacing: float) -> FloatArray:
    """Return points on a ring, at most `spacing` apart, corners among them, (N, 2)."""
    points = []
    for e in edges:
        if len(e) == 4:
            count = math.ceil(math.dist(e[:2], e[2:]) / spacing)
            t = np.arange(count)[:, None] / count
            points.append(np.array(e[:2]) * (1 - t) + np.array(e[2:]) * t)
        else:
            count = math.ceil(abs(e[4]) * e[2] / spacing)
            turns = e[3] + e[4] * np.arange(count) / count
            points.append(
                np.array(e[:2]) + e[2] * np.stack([np.cos(turns), np.sin(turns)], 1)
            )
    return np.concatenate(points)


def _turned(x: float, y: float, turn: float) -> tuple[float, float]:
    c, s = math.cos(turn), math.sin(turn)
    return (c * x - s * y, s * x + c * y)
