"""Density of an angle's error on the circle."""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.angle_budget import AngleError

# A normal angle beyond so many sigmas, 1e-15, is lost in the rounding of 1.
ANGLE_SIGMAS = 8.0
FREE_ANGLE_RAD = math.pi  # one sigma, from which on every angle is as likely
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def angle_density(
    angle: AngleError, middle_rad: float, turns: FloatArray
) -> FloatArray:
    """Return the density of the angle's error, per rad, at turns (N,).

    A normal one of s cut off at c plus a normal one of r: the normal one of both times
    the share of what was cut off that leads there.
    """
    off = turns - middle_rad
    sigma = _uncut(angle)
    if sigma >= FREE_ANGLE_RAD and math.isinf(angle.cut_rad):
        return np.full(len(turns), 1 / math.tau)
    more = math.ceil(max(ANGLE_SIGMAS * sigma - math.pi, 0.0) / math.tau)
    around = off[:, None] + math.tau * np.arange(-more, more + 1)
    density = np.exp(-((around / sigma) ** 2) / 2) / sigma / math.sqrt(math.tau)
    if not math.isinf(angle.cut_rad) and angle.left_rad > 0:
        density = density * _cut_share(angle, around) / angle.left_inside
    found: FloatArray = density.sum(axis=1)
    return found


def _uncut(angle: AngleError) -> float:
    return math.hypot(angle.left_rad, angle.rest_rad)


def _cut_share(angle: AngleError, off: FloatArray) -> FloatArray:
    """Return the probability that an error `off` left from inside the cut, (N,)."""
    left, rest, cut = angle.left_rad, angle.rest_rad, angle.cut_rad
    if rest <= 0:
        return (np.abs(off) < cut).astype(np.float64)
    middle = off * (left / _uncut(angle)) ** 2
    sigma = left * rest / _uncut(angle)
    ends = [special.ndtr((side * cut - middle) / sigma) for side in (1, -1)]
    share: FloatArray = ends[0] - ends[1]
    return share


def angle_mass(angle: AngleError, middle_rad: float, low: float, high: float) -> float:
    """Return the probability that the angle's error ends between two turns."""
    reach = ANGLE_SIGMAS * _uncut(angle)
    if _uncut(angle) < FREE_ANGLE_RAD:
        low = max(low, middle_rad - reach)
        high = min(high, middle_rad + reach)
    if high <= low:
        return 0.0
    count = 1 + math.ceil((high - low) / max(_uncut(angle), 1e-12) / 2)
    cuts = np.linspace(low, high, count + 1)
    half = np.diff(cuts)[:, None] / 2
    turns = cuts[:-1, None] + half * (1 + _NODES)
    density = angle_density(angle, middle_rad, turns.ravel()).reshape(turns.shape)
    return float((half * density * _WEIGHTS).sum())
