"""Swept volumes of motions, as convex prisms, with their collision test.

No path between two readings is supposed: axes that are ordered together may arrive one
after the other, so that a move covers all positions between its ends, axis by axis.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import AxisReading

# What sums of readings may miss contact by: plans carry six digits, of at most 10 mm.
ROUNDING_UM = 1e-2
# A piece of an arc; its corner is off by 1 - cos(2.5 deg), a thousandth.
TURN_RAD = math.radians(5.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptVolume:
    """A convex polygon times a range of heights, in the world."""

    owner: str
    corners_um: FloatArray  # (N, 2), counter-clockwise, N >= 3
    low_um: float
    high_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Travel:
    """The two ends of a motion of one axis group, with its centre of rotation."""

    start: AxisReading
    end: AxisReading
    pivot_um: tuple[float, float] = (0.0, 0.0)  # at reading 0; travels along

    def heights_um(self, volume: SweptVolume) -> tuple[float, float]:
        """Return least and greatest height of `volume` during the motion, um."""
        ends = (self.start.z_um, self.end.z_um)
        return volume.low_um + min(ends), volume.high_um + max(ends)

    def covered(self, volume: SweptVolume) -> Iterator[SweptVolume]:
        """Yield volumes that together hold all that `volume` covers during the motion.

        `volume` is where it is with the axes at reading 0.
        """
        a, b = self.start, self.end
        low_um, high_um = self.heights_um(volume)
        pivot = np.array(self.pivot_um)
        xs, ys = sorted({a.x_um, b.x_um}), sorted({a.y_um, b.y_um})
        shifts = [pivot + np.array((x, y)) for x in xs for y in ys]
        for arcs in _turned(volume.corners_um - pivot, a.theta_rad, b.theta_rad):
            corners = np.concatenate([arcs + shift for shift in shifts])
            turned_only = len(corners) == len(volume.corners_um)  # convex as it was
            yield SweptVolume(
                owner=volume.owner,
                corners_um=corners if turned_only else hull(corners),
                low_um=low_um,
                high_um=high_um,
            )


def meets(volume: SweptVolume, other: SweptVolume, *, margin_um: float = 0.0) -> bool:
    """Return whether two volumes overlap, or come closer than a margin.

    Convex shapes are apart if and only if a line along an edge of one of them parts
    them; the gap along its normal is at most their distance, so that a margin is kept
    on the safe side.
    """
    least_um = margin_um - ROUNDING_UM
    height_um = max(volume.low_um - other.high_um, other.low_um - volume.high_um)
    if height_um >= least_um:
        return False
    first, second = volume.corners_um, other.corners_um
    for corners, away in ((first, second), (second, first)):
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.stack((edges[:, 1], -edges[:, 0]), axis=1)
        normals /= np.hypot(edges[:, 0], edges[:, 1])[:, None]
        ends = (normals * corners).sum(axis=1)
        if ((away @ normals.T).min(axis=0) - ends).max() >= least_um:
            return False
    return True


def first_meeting(
    volume: SweptVolume, others: Iterable[SweptVolume], *, margin_um: float = 0.0
) -> SweptVolume | None:
    """Return the first of `others` that a volume meets, None if all stay apart."""
    return next((o for o in others if meets(volume, o, margin_um=margin_um)), None)


def hull(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of (N, 2) um, counter-clockwise, (M, 2) um.

    References
    ----------
    Andrew (1979), the monotone chain.
    """
    ranked = np.unique(np.round(points, 9), axis=0)
    if len(ranked) < 3:
        return np.asarray(ranked)
    lower, upper = _chain(ranked), _chain(ranked[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(ranked: FloatArray) -> list[tuple[float, float]]:
    """Return one side of the hull of points in rising or falling order."""
    found: list[tuple[float, float]] = []
    for x, y in ranked.tolist():
        while len(found) > 1:
            (ax, ay), (bx, by) = found[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            found.pop()
        found.append((x, y))
    return found


def _turned(corners: FloatArray, start: float, end: float) -> Iterator[FloatArray]:
    """Yield (M, 2) points, um, whose hulls hold the corners from angle to angle, rad.

    An arc lies within its ends and the point where their tangents meet. Beyond a whole
    rotation there is nothing more to cover.
    """
    if abs(end - start) > math.tau:
        end = start + math.copysign(math.tau, end - start)
    count = max(1, math.ceil(abs(end - start) / TURN_RAD))
    angles = np.linspace(start, end, count + 1)
    if start == end:
        yield _rotated(corners, start)
        return
    half = (end - start) / count / 2
    for a, b in itertools.pairwise(angles.tolist()):
        tips = _rotated(corners, (a + b) / 2) / math.cos(half)
        yield np.concatenate((_rotated(corners, a), tips, _rotated(corners, b)))


def _rotated(corners: FloatArray, angle_rad: float) -> FloatArray:
    """Rotate points about the origin, (N, 2) um to (N, 2) um."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    turned: FloatArray = corners @ np.array([[c, s], [-s, c]])
    return turned
