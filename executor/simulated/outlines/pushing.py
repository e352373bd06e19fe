"""The smallest motion of a part that brings posts back inside its holes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.containment import inside
from microplan.executor.simulated.outlines.crossing import (
    distances_um,
    edge_distances_um,
    enclosed,
    moved,
)
from microplan.schemas.pose import Pose

FREE_UM = 2e-4  # left between what was pushed apart: far above rounding
ROUNDS = 40  # of making the contacts straight; a few are enough
MOST_STEPS = 200  # over the deepest contact alone
FARTHEST_UM = 1000.0  # no push goes farther: what needs more does not fit at all

Pair = tuple[FloatArray, FloatArray]  # corners of a hole and of its post, (N, 2) um


@dataclass(frozen=True, slots=True)
class _Contact:
    """A corner of one outline that may not pass a straight line of the other."""

    corner: FloatArray  # (2,) um, of the post, or of the hole where `of_hole`
    foot: FloatArray  # (2,) um, on the line, in the other one's frame
    normal: FloatArray  # (2,) to the free side, in the other one's frame
    of_hole: bool


def smallest_motion(
    pairs: Sequence[Pair], center_um: tuple[float, float], reach_um: float
) -> Pose | None:
    """Return the smallest motion of posts that puts each of them inside its hole.

    The smallest of dx^2 + dy^2 + (reach_um dtheta)^2 with the shift taken at
    `center_um`, by repeated least-distance steps over the contacts met on the way.
    What is moved back by it, the part with the holes, moves as far.

    Parameters
    ----------
    pairs : sequence of pairs of (N, 2) float arrays
        Corners of hole and post, counter-clockwise, um, in the frame of the holes'
        part. All posts move together.
    center_um : (float, float)
        Where the shift is counted, in the same frame.
    reach_um : float
        Lever at which an angle is counted like a shift.

    Returns
    -------
    Pose or None
        In the same frame; the identity if all fit already, None if no motion helps.
    """
    center = np.array(center_um)
    motion = _least(pairs, center, reach_um)
    return motion if motion is not None else _any(pairs, center, reach_um)


def _least(pairs: Sequence[Pair], center: FloatArray, reach_um: float) -> Pose | None:
    """Return the least motion that satisfies all contacts met on the way to it."""
    contacts: list[_Contact] = []
    shift = np.zeros(3)  # dx, dy, reach dtheta
    for _ in range(ROUNDS):
        motion = _pose(shift, center, reach_um)
        found = _met(pairs, motion)
        if found is None:
            return motion
        contacts += [contact for _, contact in found]
        slopes, gaps = _rows(contacts, motion, center, reach_um)
        step = least_distance(slopes, FREE_UM + slopes @ shift - gaps)
        if step is None or float(np.abs(step).max()) > FARTHEST_UM:
            return None
        shift = step
    return None


def _any(pairs: Sequence[Pair], center: FloatArray, reach_um: float) -> Pose | None:
    """Return a motion found by going back over the deepest contact, again and again.

    For what was pushed past its neighbour, where not all contacts first met can hold.
    """
    shift = np.zeros(3)
    for _ in range(MOST_STEPS):
        motion = _pose(shift, center, reach_um)
        found = _met(pairs, motion)
        if found is None:
            return motion
        deepest = max((depth for depth, _ in found), default=0.0)
        contacts = [contact for depth, contact in found if depth == deepest]
        slopes, gaps = _rows(contacts, motion, center, reach_um)
        step = least_distance(slopes, FREE_UM - gaps)
        if step is None:
            return None
        shift = shift + step
    return None


def _pose(shift: FloatArray, center: FloatArray, reach_um: float) -> Pose:
    """Return the motion of a shift at a centre and an angle, as a pose."""
    theta_rad = float(shift[2]) / reach_um
    x, y = Pose(x_um=0.0, y_um=0.0, theta_rad=theta_rad).apply(*center)
    return Pose(
        x_um=float(center[0] + shift[0] - x),
        y_um=float(center[1] + shift[1] - y),
        theta_rad=theta_rad,
    )


def _rows(
    contacts: Sequence[_Contact], motion: Pose, center: FloatArray, reach_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return slopes (K, 3) and gaps (K,) um of contacts at a motion."""
    rows = [_row(contact, motion, center, reach_um) for contact in contacts]
    slopes = np.array([slope for slope, _ in rows]).reshape(-1, 3)
    return slopes, np.array([gap for _, gap in rows])


def _row(
    contact: _Contact, motion: Pose, center: FloatArray, reach_um: float
) -> tuple[FloatArray, float]:
    """Return a contact's gap (um) at a motion, and its slopes by dx, dy, turn, (3,)."""
    c, s = math.cos(motion.theta_rad), math.sin(motion.theta_rad)
    turn = np.array([[c, -s], [s, c]])
    at = np.array(motion.apply(*center))  # where the centre goes
    if contact.of_hole:
        corner, foot = contact.corner, moved(contact.foot[None], motion)[0]
        normal = -(turn @ contact.normal)  # the post's line moves, the corner stays
        arm = corner - at
        gap = float(-normal @ (corner - foot))
    else:
        corner, foot = moved(contact.corner[None], motion)[0], contact.foot
        normal = contact.normal
        arm = corner - at
        gap = float(normal @ (corner - foot))
    lever = float(normal[1] * arm[0] - normal[0] * arm[1])
    return np.array([normal[0], normal[1], lever / reach_um]), gap


def _met(pairs: Sequence[Pair], motion: Pose) -> list[tuple[float, _Contact]] | None:
    """Return contacts of corners on the wrong side, with depths; None if all fit."""
    found: list[tuple[float, _Contact]] = []
    fits, back = True, motion.inverse()
    for hole, post in pairs:
        now, before = moved(post, motion), moved(hole, back)
        if inside(hole, now):
            continue
        fits = False
        out = _convex(now) & ~enclosed(now, hole)
        for i, depth in _worst(out, now, hole):
            for foot, normal in _lines(now[i], hole, sign=1.0):
                found.append((depth, _Contact(post[i], foot, normal, of_hole=False)))
        into = ~_convex(hole) & enclosed(before, post)
        for i, depth in _worst(into, before, post):
            for foot, normal in _lines(before[i], post, sign=-1.0):
                found.append((depth, _Contact(hole[i], foot, normal, of_hole=True)))
    return None if fits else found


def _convex(ring: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which corners of a left-turning ring turn left, (N,) bool."""
    before = ring - np.roll(ring, 1, axis=0)
    after = np.roll(ring, -1, axis=0) - ring
    left: npt.NDArray[np.bool_] = (
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0
    )
    return left


def _worst(
    wrong: npt.NDArray[np.bool_], corners: FloatArray, ring: FloatArray
) -> Iterator[tuple[int, float]]:
    """Yield the farthest corner of each run on the wrong side, and its distance."""
    where = np.flatnonzero(wrong)
    if not len(where):
        return
    far = distances_um(corners[where], ring)
    runs = np.split(np.arange(len(where)), np.flatnonzero(np.diff(where) > 1) + 1)
    for run in runs:
        i = run[int(np.argmax(far[run]))]
        yield int(where[i]), float(far[i])


def _lines(
    point: FloatArray, ring: FloatArray, *, sign: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield foot and normal of the edges nearest to a point: two at a corner."""
    far = edge_distances_um(point[None], ring)[0]
    for i in np.flatnonzero(far <= far.min() + 1e-9):
        edge = ring[(i + 1) % len(ring)] - ring[i]
        normal = np.array([-edge[1], edge[0]]) / float(np.hypot(*edge))
        yield ring[i], sign * normal


def least_distance(slopes: FloatArray, least: FloatArray) -> FloatArray | None:
    """Return the shortest (N,) x with slopes @ x >= least, None if there is none.

    Parameters
    ----------
    slopes : (K, N) float array
    least : (K,) float array

    References
    ----------
    Lawson & Hanson (1974), Solving Least Squares Problems, ch. 23: LDP by NNLS.
    """
    count = slopes.shape[1]
    columns = np.vstack([slopes.T, least])
    wanted = np.zeros(count + 1)
    wanted[count] = 1.0
    rest = columns @ _non_negative(columns, wanted) - wanted
    if -rest[count] < 1e-10:  # of 1: the least residual is 1 / (1 + |x|^2)
        return None
    found: FloatArray = rest[:count] / -rest[count]
    return found


def _non_negative(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return u >= 0 with the least |columns @ u - wanted|, (K,)."""
    u = np.zeros(columns.shape[1])
    used = np.zeros(len(u), dtype=bool)
    for _ in range(10 * len(u)):
        gain = columns.T @ (wanted - columns @ u)
        gain[used] = -np.inf
        best = int(np.argmax(gain))
        if gain[best] <= 1e-12:
            break
        used[best] = True
        while used.any():
            free = np.zeros(len(u))
            free[used] = np.linalg.lstsq(columns[:, used], wanted, rcond=None)[0]
            if free[used].min() > 0:
                u = free
                break
            falls = used & (free <= 0)
            share = float((u[falls] / np.maximum(u[falls] - free[falls], 1e-300)).min())
            u = u + share * (free - u)
            used &= u > 1e-15
            u[~used] = 0.0
    return u
