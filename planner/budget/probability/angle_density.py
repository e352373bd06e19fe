"""Density of an angle's error on the circle."""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.quadrature import cuts_between, nodes_between

# A normal angle beyond so many sigmas, 1e-15, is lost in the rounding of 1.
ANGLE_SIGMAS = 8.0
FREE_ANGLE_RAD = math.pi  # one sigma, from which on every angle is as likely
NODES = 12  # per piece; pieces are two sigmas long


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


def angle_moments(
    angle: AngleError, middle_rad: float, low: float, high: float, count: int
) -> FloatArray:
    """Return the integrals of Chebyshev polynomials times the angle's density.

    Parameters
    ----------
    angle : AngleError
        The angle's error.
    middle_rad : float
        Of the angle.
    low, high : float
        Turns, rad; the polynomials are those of -1..1 stretched over them.
    count : int
        N, of polynomials, T_0 = 1 the first: its integral is P between the turns.

    Returns
    -------
    (N,) float64 array
        Dimensionless [1]. Zero farther than ANGLE_SIGMAS from the middle.
    """
    sigma, cut = _uncut(angle), angle.cut_rad
    first, last = low, high
    steps = np.arange(-ANGLE_SIGMAS, ANGLE_SIGMAS + 1, 2)
    cuts = middle_rad + steps * sigma
    if sigma < FREE_ANGLE_RAD:
        first, last = max(low, cuts[0]), min(high, cuts[-1])
    if last <= first:
        return np.zeros(count)
    if not math.isinf(cut):
        edges = middle_rad + np.array([-cut, cut])[:, None] + steps * angle.rest_rad
        cuts = np.concatenate([cuts, edges.ravel()])
    turns, weights = nodes_between(cuts_between(first, cuts, last), NODES)
    weights = weights * angle_density(angle, middle_rad, turns)
    share = (2 * turns - low - high) / (high - low)
    found: FloatArray = weights @ np.polynomial.chebyshev.chebvander(share, count - 1)
    return found
