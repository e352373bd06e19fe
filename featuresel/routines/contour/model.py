"""A drawing as a matcher sees it: points, expected gradients, effects of rotations.

Points are (N, 5) arrays: x, y in px of the target's frame (y up, at theta 0), the unit
vector from dark to bright there, and the weight. Directions of gradients are as
displayed: x right, y up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contour.polarity import Prediction
from microplan.featuresel.routines.contract import Target

ROUND = 0  # order of the symmetry of what looks alike at every angle
_APART_PX = 1.5  # of points: closer ones share their pixels
_MOST = 360  # points; more take time and tell little
_NEAR_PX = 1.0  # of points that are the same after a turn
_ALIKE = 0.9  # cosine between their gradients
_SHARE = 0.7  # of the points must have a partner in a symmetry
_MORE = 0.1  # of the points must prefer a symmetry of some order to any turn
_HIGHEST = 40  # order of the symmetries looked for
# turns of no order up to `_HIGHEST`, from which what is round looks the same
_ANY_RAD = tuple(0.11 + 2 * math.pi * k / 31 for k in range(31))


@dataclass(frozen=True, slots=True, kw_only=True)
class ContourModel:
    """What is matched, and what rotations do to it."""

    points: FloatArray  # (N, 5), see the module
    order: int  # of the rotational symmetry of most of it; 1: none, 0: round
    breaking: BoolArray  # (N,) points that distinguish the turns of the symmetry


def build(target: Target, seen: Prediction) -> ContourModel:
    """Return the model of the edges that can be relied on; it may have no points."""
    contour = np.array(target.contour, dtype=np.float64).reshape(-1, 4)
    k = target.px_per_um
    own = np.flatnonzero(seen.kept)
    own = own[_apart(contour[own, :2] * k)]
    if len(own) > _MOST:
        own = own[np.linspace(0, len(own) - 1, _MOST).round().astype(np.intp)]
    step = seen.step[own]
    typical = float(np.median(np.abs(step))) if len(own) else 1.0
    points = np.column_stack(
        (
            contour[own, :2] * k,
            contour[own, 2:] * np.sign(step)[:, None],
            np.minimum(np.abs(step) / typical, 1.0),
        )
    )
    drawn = np.hstack((contour[:, :2] * k, contour[:, 2:]))
    thinned = drawn[_apart(drawn[:, :2])]
    order, breaking = _symmetry(thinned, drawn[own], target.symmetry)
    if target.kind == "circle":  # and nothing else, however little of it is seen
        order, breaking = ROUND, np.zeros_like(breaking)
    return ContourModel(points=points, order=order, breaking=breaking)


def turned(points: FloatArray, theta_rad: float) -> FloatArray:
    """Return points (N, 5) turned counter-clockwise about the reference point."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    turn = np.array(((c, s), (-s, c)))
    return np.hstack((points[:, :2] @ turn, points[:, 2:4] @ turn, points[:, 4:]))


def rim_px(points: FloatArray) -> float:
    """Return the distance of the farthest of (N, 4) points from the reference, px."""
    return float(np.hypot(points[:, 0], points[:, 1]).max())


def _apart(places: FloatArray) -> npt.NDArray[np.intp]:
    """Return indices of points in order, none nearer than `_APART_PX` to the last."""
    chosen: list[int] = []
    last = (math.inf, math.inf)
    for i, (x, y) in enumerate(places.tolist()):
        if math.hypot(x - last[0], y - last[1]) >= _APART_PX:
            chosen.append(i)
            last = (x, y)
    return np.array(chosen, dtype=np.intp)


def _symmetry(
    drawn: FloatArray, own: FloatArray, declared: int
) -> tuple[int, BoolArray]:
    """Return the order of the symmetry of points seen, and which of them break it.

    All are (N, 4), positions and normals. A partner may be any point that is drawn:
    what light or blur hide does not turn with the part.
    """
    nothing = np.zeros(len(own), dtype=np.bool_)
    if len(own) < 3:
        return 1, nothing
    round_ = np.array([_lone(own, drawn, turn) for turn in _ANY_RAD])
    orders = sorted({declared, *range(2, _HIGHEST + 1)} - {0, 1}, reverse=True)
    for order in orders:
        if float(_lone(own, drawn, 2 * math.pi / order).mean()) > 1 - _SHARE:
            continue
        turns = 2 * math.pi / order * np.arange(1, order)
        lone = np.array([_lone(own, drawn, float(turn)) for turn in turns])
        if float(lone.mean()) < min(1 - _SHARE, float(round_.mean()) - _MORE):
            return order, lone.mean(axis=0) > 0.5
    if float(round_.mean()) < 1 - _SHARE:
        return ROUND, round_.mean(axis=0) > 0.5
    return 1, nothing


def _lone(own: FloatArray, drawn: FloatArray, turn_rad: float) -> BoolArray:
    """Return which points, turned, have no partner among those drawn."""
    moved = turned(own, turn_rad)
    apart = np.hypot(moved[:, 0, None] - drawn[:, 0], moved[:, 1, None] - drawn[:, 1])
    alike = moved[:, 2:4] @ drawn[:, 2:4].T
    partners = (apart <= _NEAR_PX) & (alike >= _ALIKE)
    return np.logical_not(partners.any(axis=1))
