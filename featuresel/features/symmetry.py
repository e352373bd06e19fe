"""Rotational symmetry of rings: how much of them meets itself when turned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from microplan.arrays import BoolArray, FloatArray, Point
from microplan.featuresel.features.ring_cleanup import Clean

NEAR = 2e-3  # of the radius: edges nearer than this meet when one is turned
WHOLE = 0.998  # of the length has to meet for a symmetry that nothing breaks
PATTERN = 0.7  # of the length has to meet for a pattern with something missing
TRIED = 400  # points that are turned
_SMALL_ORDERS = range(2, 13)  # tried on anything
_MOST_TEETH = 360


@dataclass(frozen=True, slots=True)
class RingSamples:
    """Points along rings, to be compared with themselves turned."""

    tried: FloatArray  # (N, 2) um, evenly along the rings
    tree: cKDTree  # of points so dense that their spacing does not matter
    center_um: Point
    radius_um: float  # of the farthest point from the centre

    def share(self, turn_rad: float) -> float:
        """Return the share of the length that meets the rings when turned."""
        return float(self.meets(turn_rad).mean())

    def meets(self, turn_rad: float) -> BoolArray:
        """Return which of the points meet the rings when turned, (N,)."""
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        rays = self.tried - np.array(self.center_um)
        turned = rays @ np.array([[c, s], [-s, c]]) + np.array(self.center_um)
        away, _ = self.tree.query(turned)
        return np.asarray(away <= NEAR * self.radius_um, dtype=np.bool_)


def curve(rings: Sequence[Clean], center_um: Point) -> RingSamples:
    """Return the rings as a curve about a point."""
    corners = np.concatenate([ring.points for ring in rings])
    radius = float(np.hypot(*(corners - np.array(center_um)).T).max())
    spacing = NEAR * radius / 4  # adds at most an eighth of it to a distance
    length = sum(ring.length_um for ring in rings)
    return RingSamples(
        tried=along(rings, length / TRIED),
        tree=cKDTree(along(rings, spacing)),
        center_um=center_um,
        radius_um=radius,
    )


def order_of(shape: RingSamples) -> tuple[int, float, int]:
    """Return the order of the symmetry, and how alike the likeliest wrong rotation is.

    Returns
    -------
    (int, float, int)
        The order of all rotations that meet; 1 if none does, 0 if any does. The share
        that meets for the best of the other orders, whose rotations the symmetry lacks,
        and that order.
    """
    if _background(shape) >= WHOLE:
        return 0, 0.0, 1
    shares = {n: shape.share(math.tau / n) for n in _orders(shape)}
    order = math.lcm(*(n for n, share in shares.items() if share >= WHOLE))
    others = [(share, n) for n, share in shares.items() if order % n]
    alike, other = max(others, default=(0.0, 1))
    return order, alike, other


def pattern_of(shape: RingSamples) -> tuple[int, float]:
    """Return the order of a pattern that may be interrupted, and how much of it meets.

    What meets under any rotation, as round parts do, does not count: 1 means that all
    the rest meets, and less than `PATTERN` is no pattern (order 1).
    """
    base = _background(shape)
    if base >= WHOLE:
        return 1, 0.0
    shares = {
        n: (shape.share(math.tau / n) - base) / (1 - base) for n in _orders(shape)
    }
    order = max((n for n, share in shares.items() if share >= PATTERN), default=1)
    return order, shares.get(order, 0.0)


def centroid(rings: Sequence[Clean]) -> Point:
    """Return the centroid of the area between the rings."""
    area = moment_x = moment_y = 0.0
    origin = rings[0].points[0]  # near: less is lost to rounding
    for ring in rings:
        x, y = (ring.points - origin).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area += float(cross.sum()) / 2
        moment_x += float((cross * (x + np.roll(x, -1))).sum()) / 6
        moment_y += float((cross * (y + np.roll(y, -1))).sum()) / 6
    if not abs(area) > 0:
        x, y = rings[0].points.mean(axis=0)
        return (float(x), float(y))
    return (float(origin[0] + moment_x / area), float(origin[1] + moment_y / area))


def along(rings: Sequence[Clean], spacing_um: float) -> FloatArray:
    """Return points evenly along the rings, (N, 2) um, about `spacing_um` apart."""
    found = []
    for ring in rings:
        closed = np.vstack([ring.points, ring.points[:1]])
        steps = np.hypot(*np.diff(closed, axis=0).T)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(8, math.ceil(at[-1] / spacing_um))
        where = (np.arange(count) + 0.5) / count * at[-1]
        found.append(
            np.column_stack([np.interp(where, at, closed[:, k]) for k in (0, 1)])
        )
    return np.concatenate(found)


def _background(shape: RingSamples) -> float:
    """Return the share that meets under rotations that no pattern has."""
    return max(shape.share(math.tau / n) for n in (89, 97))


def _orders(shape: RingSamples) -> list[int]:
    """Return the orders worth trying: small ones, and those of what goes in and out."""
    orders = set(_SMALL_ORDERS)
    reach = np.hypot(*(shape.tried - np.array(shape.center_um)).T)
    for level in np.linspace(0.05, 0.95, 10):  # teeth may be a tenth of all there is
        middle = reach.min() + level * (reach.max() - reach.min())
        count = int(np.count_nonzero((reach > middle) & (np.roll(reach, 1) <= middle)))
        for near in (count - 1, count, count + 1):  # a notch adds or hides one
            most = min(near, _MOST_TEETH)
            orders |= {n for n in range(2, most + 1) if near % n == 0}
    return sorted(orders)
