"""Insertion probability of a round fit from capture radius and residual.

The error at insertion is e = m + n: m what the servo leaves (normal with the stage's
repeatability, cut off at the tolerance, since the servo stops inside it and only there)
and n everything it cannot see (normal, with a bias). The part goes in if |e| is below
the capture radius, which itself varies with the sizes as fabricated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.miss_density import VaryingRadius
from microplan.planner.budget.probability.miss_probability import probability_beyond
from microplan.planner.budget.probability.servo_landing import Landing
from microplan.planner.views.alignments import LEAST_SIGMAS

NODES = 48  # Gauss nodes over the residual, in probability
SAME_SIZE_UM = 1e-9  # sizes that vary by less do not vary
# Share of the failures allowed to the whole task that the servo may use up.
SERVO_SHARE = 0.1
# The servo is not asked for less than this many stage sigmas where more would do no
# harm: 1 / (1 - exp(-0.9**2 / 2)) = 3.0 looks on average.
EASY_SIGMAS = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundFit:
    """A round hole over a round shaft, radii as drawn, edge offsets as tolerances."""

    hole_um: float  # radius
    shaft_um: float  # radius
    hole_tolerance_um: float  # hard limit of the radius' error, uniform within
    shaft_tolerance_um: float
    taper_um: float = 0.0  # what leaning walls take of the capture radius

    @property
    def capture_um(self) -> float:
        """Return the largest sideways error that still goes in, sizes as drawn."""
        return self.hole_um - self.shaft_um - self.taper_um

    @property
    def room(self) -> VaryingRadius:
        """Return the distribution of the capture radius over the fabricated sizes."""
        sides = sorted((self.hole_tolerance_um, self.shaft_tolerance_um))
        reach, flat = sides[1] + sides[0], sides[1] - sides[0]
        if reach <= SAME_SIZE_UM:
            reach = flat = 0.0
        return VaryingRadius(radius_um=self.capture_um, flat_um=flat, reach_um=reach)


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """Residual of a servo: normal, `sigma_um` per axis, cut off at `within_um`."""

    sigma_um: float
    within_um: float

    def radii(self) -> tuple[FloatArray, FloatArray]:
        """Return radii of the residual and their weights, (N,) um and (N,)."""
        if self.sigma_um <= 0 or self.within_um <= 0:
            return np.zeros(1), np.ones(1)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        # uniform in the cumulated probability of the cut-off Rayleigh distribution
        share = (nodes + 1) / 2 * -math.expm1(-self._exponent)
        radius = self.sigma_um * np.sqrt(-2 * np.log1p(-share))
        return radius, weights / 2

    @property
    def inside(self) -> float:
        """Return the probability that one move ends inside."""
        return -math.expm1(-self._exponent)

    @property
    def _exponent(self) -> float:
        if self.sigma_um <= 0:
            return math.inf
        ratio = self.within_um / self.sigma_um
        return ratio * ratio / 2


def miss_probability(
    fit: RoundFit, residual: Residual, sigma_um: float, bias_um: float = 0.0
) -> float:
    """Return the probability that the part does not go in.

    Parameters
    ----------
    fit : RoundFit
        Hole and shaft.
    residual : Residual
        What the servo leaves.
    sigma_um : float
        Everything the servo cannot see, one sigma per axis.
    bias_um : float
        Constant error that is not corrected, >= 0.

    Returns
    -------
    float
        In 0..1, summed over tails, so that tiny probabilities keep their digits.

    Notes
    -----
    The bias has no fixed angle to what the servo leaves.
    """
    landing = Landing(
        bias_um=bias_um, sigma_um=residual.sigma_um, within_um=residual.within_um
    )
    return probability_beyond(fit.room, landing, sigma_um)


def expected_looks(residual: Residual) -> float:
    """Return the mean number of looks of a servo of gain 1 until it stops inside."""
    return 1 / residual.inside if residual.inside > 0 else math.inf


def servo_tolerance_um(
    fit: RoundFit, move_sigma_um: float, sigma_um: float, goal: float
) -> float:
    """Return the tolerance of an alignment before inserting, um.

    The loosest tolerance at which misses use up at most SERVO_SHARE of the failures
    that `goal` allows; never below EASY_SIGMAS stage sigmas, where looks are cheap, nor
    above half the capture radius, where the answer would depend on the tail.
    """
    allowed = SERVO_SHARE * (1 - goal)
    ceiling = max(fit.capture_um / 2, LEAST_SIGMAS * move_sigma_um)
    floor = min(EASY_SIGMAS * move_sigma_um, ceiling)
    steps = np.linspace(ceiling, floor, 33)
    for within in steps:
        residual = Residual(sigma_um=move_sigma_um, within_um=float(within))
        if miss_probability(fit, residual, sigma_um) <= allowed:
            return float(within)
    return float(floor)


def combine(sigmas: Sequence[float]) -> float:
    """Return the root of the sum of squares."""
    return math.sqrt(sum(s * s for s in sigmas))
