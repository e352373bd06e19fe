"""Probability that an error lands beyond a radius that itself varies.

The error is e = b + m + n: a bias b, what a servo leaves m (normal, cut off at a circle
about nothing, of no fixed angle to b) and the unseen rest n (normal). With W = |b + m|
and Q(w, C) the probability that n carries an error of size w beyond the radius C,

    P(|e| >= C) = E Q(W, C) = Q(0, C) + int_0^inf dQ/dw(w, C) P(W >= w) dw

by parts. Two smooth factors remain: the mean of dQ/dw over the radii, a bump about as
wide as n and the radii's standard deviation, and P(W >= w), an integral over the circle
of radius w. Neither sees the other, all terms are positive, and their edges are known,
so that Gauss nodes between the edges serve for any ratio of the lengths.
"""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.miss_density import (
    TAIL_SIGMAS,
    VaryingRadius,
    miss_density,
    radii_near,
)
from microplan.planner.budget.probability.quadrature import (
    cuts_between,
    nodes_between,
    nodes_between_roots,
)
from microplan.planner.budget.probability.servo_landing import (
    BODY_SIGMAS,
    STEP_SIGMAS,
    TAIL_STEP_SIGMAS,
    Landing,
)

# A length below this share of all the others is lost in their rounding.
NEGLIGIBLE = 1e-15
NODES = 16  # per piece along w


def probability_beyond(room: VaryingRadius, landing: Landing, sigma_um: float) -> float:
    """Return the probability that an error reaches or passes a varying radius.

    Parameters
    ----------
    room : VaryingRadius
        Law of the radius; where it is not positive, everything is beyond.
    landing : Landing
        Bias and what a servo leaves.
    sigma_um : float
        Normal rest, one sigma per axis.

    Returns
    -------
    float
        In 0..1. Small probabilities keep their digits;
        tests/planner/budget/probability/test_miss_probability.py says how many.

    References
    ----------
    dQ/dw = C / s**2 exp(-(w**2 + C**2) / (2 s**2)) I1(w C / s**2) for the Rice
    distribution's tail Q(w, C): Marcum's function of first order.
    """
    if room.radius_um + room.reach_um <= 0:
        return 1.0
    landing, sigma_um = _seen(room, landing, sigma_um)
    breaks = landing.breaks_um() - room.radius_um
    if sigma_um == 0:
        offset, weight = _sharp(room, breaks)
    else:
        offset, weight = blurred(room, sigma_um, breaks)
    always = certain_miss(room, sigma_um)
    beyond = landing.beyond(room.radius_um, offset)
    # the weights sum to 1 up to rounding, which where edges are narrow against the
    # radius is that of its position
    total = always + float(weight.sum())
    miss = (always + float(weight @ beyond)) / total
    hit = float(weight @ (1 - beyond)) / total
    return miss if miss < hit else min(1.0, max(0.0, 1 - hit))


def _seen(
    room: VaryingRadius, landing: Landing, sigma_um: float
) -> tuple[Landing, float]:
    """Return landing and sigma without what is too small or too rare to be seen."""
    within = min(landing.within_um, TAIL_SIGMAS * landing.sigma_um)
    known = abs(room.radius_um) + room.reach_um + landing.bias_um
    if within <= NEGLIGIBLE * (known + sigma_um):
        within = 0.0
    if sigma_um <= NEGLIGIBLE * (known + within):
        sigma_um = 0.0
    seen = Landing(bias_um=landing.bias_um, sigma_um=landing.sigma_um, within_um=within)
    return seen, sigma_um


def _sharp(room: VaryingRadius, breaks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return deviations of a positive radius and their weights, (N,) each."""
    low = max(-room.reach_um, -room.radius_um)
    if room.reach_um == 0:
        return np.zeros(1), np.ones(1)
    cuts = np.concatenate([room.kinks_um, breaks])
    offset, weight = nodes_between_roots(cuts_between(low, cuts, room.reach_um), NODES)
    return offset, weight * room.density(offset)


def blurred(
    room: VaryingRadius, sigma_um: float, breaks: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return offsets w - radius and weights, dQ/dw averaged over the radii; (N,)."""
    low = max(-room.radius_um, -room.reach_um - TAIL_SIGMAS * sigma_um)
    high = room.reach_um + BODY_SIGMAS * sigma_um
    body = np.arange(-BODY_SIGMAS, BODY_SIGMAS + 1, STEP_SIGMAS) * sigma_um
    tail = np.arange(-TAIL_SIGMAS, -BODY_SIGMAS, TAIL_STEP_SIGMAS) * sigma_um
    edges = room.kinks_um if room.reach_um > sigma_um else np.zeros(1)
    edges = np.append(edges, low)  # where radii end at 0, it bends within a sigma
    cuts = [(edges[:, None] + body).ravel(), -room.reach_um + tail, breaks]
    offset, weight = nodes_between_roots(
        cuts_between(low, np.concatenate(cuts), high), NODES
    )
    return offset, weight * miss_density(room, sigma_um).at(offset)


def certain_miss(room: VaryingRadius, sigma_um: float) -> float:
    """Return the probability of a miss where only the normal rest errs."""
    start = -room.radius_um
    chance = 0.0
    if start > -room.reach_um:  # no room at all
        cuts = cuts_between(-room.reach_um, room.kinks_um, start)
        deviation, weight = nodes_between(cuts, NODES)
        chance = float(weight @ room.density(deviation))
    if sigma_um > 0:
        wide, weight = radii_near(room, sigma_um, np.array([start]))
        chance += float((weight * np.exp(-((wide / sigma_um) ** 2) / 2)).sum())
    return chance
