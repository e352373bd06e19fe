"""Probability that an angle ends within a limit after a servo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.quadrature import cuts_between, nodes_between
from microplan.planner.views.alignments import inside_angle
from microplan.schemas.plan.verdicts import TurnRow

# A normal distribution beyond so many sigmas, 2e-19, is lost in the rounding of 1.
BODY_SIGMAS = 9.0
NODES = 16  # per piece; pieces are a sigma of either term long
# Probability below which more looks, or a correction of an angle, are not expected.
GIVE_UP = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleError:
    """An angle's error: normal and cut off where a servo stops, plus a normal rest."""

    left_rad: float  # of what the servo leaves, before it is cut off
    cut_rad: float  # inf: no servo
    rows: tuple[TurnRow, ...]  # what it cannot see

    @property
    def rest_rad(self) -> float:
        """Return sigma of the terms that the servo cannot see, rad."""
        return math.hypot(*(row.sigma_rad for row in self.rows))

    @property
    def sigma_rad(self) -> float:
        """Return sigma of the whole angle, rad."""
        return math.hypot(self._left_sigma_rad, self.rest_rad)

    @property
    def left_inside(self) -> float:
        """Return the probability that a servo starts inside already."""
        if self.left_rad <= 0 or math.isinf(self.cut_rad):
            return 1.0
        return math.erf(self.cut_rad / self.left_rad / math.sqrt(2))

    @property
    def _left_sigma_rad(self) -> float:
        """Return sigma of the servo's residual, rad, as it is cut off.

        s**2 (1 - 2 a phi(a) / (2 Phi(a) - 1)) at a = cut / s; near c**2 / 3 for small a
        it cancels, and is taken as that of a uniform distribution.
        """
        if self.left_rad <= 0 or math.isinf(self.cut_rad):
            return self.left_rad
        a = self.cut_rad / self.left_rad
        # the uniform distribution's variance is off by a**2 / 15 of itself
        if a < 1e-3:
            return self.cut_rad / math.sqrt(3)
        density = math.exp(-a * a / 2) / math.sqrt(2 * math.pi)
        inside = math.erf(a / math.sqrt(2))
        return self.left_rad * math.sqrt(max(1 - 2 * a * density / inside, 0.0))

    def beyond(self, within_rad: float) -> float:
        """Return the probability of an angle beyond +-within_rad; tails kept."""
        if not within_rad > 0:
            raise ValueError(f"within_rad must be positive, got {within_rad}")
        if math.isinf(self.cut_rad) or self.left_rad <= 0:
            sigma = math.hypot(self.left_rad, self.rest_rad)
            if sigma <= 0:
                return 0.0
            return math.erfc(within_rad / sigma / math.sqrt(2))
        left, weight = self._left(within_rad)
        return float(weight @ self._rest_beyond(within_rad, left))

    def _left(self, within_rad: float) -> tuple[FloatArray, FloatArray]:
        """Return angles that the servo leaves, and their weights, (N,) each."""
        s, t = self.left_rad, self.rest_rad
        reach = min(self.cut_rad, BODY_SIGMAS * s)
        steps = np.arange(-BODY_SIGMAS, BODY_SIGMAS + 1)
        ends = np.array([-within_rad, within_rad])
        turns = np.concatenate([steps * s, (ends[:, None] + steps * t).ravel()])
        left, weight = nodes_between(cuts_between(-reach, turns, reach), NODES)
        law = weight * np.exp(-((left / s) ** 2) / 2)
        return left, law / law.sum()

    def _rest_beyond(self, within_rad: float, left: FloatArray) -> FloatArray:
        """Return the probability that the rest carries each angle beyond, (N,)."""
        if self.rest_rad <= 0:
            return (np.abs(left) >= within_rad).astype(np.float64)
        sides = [(within_rad + side * left) / self.rest_rad for side in (1, -1)]
        more, less = (special.erfc(z / math.sqrt(2)) for z in sides)
        found: FloatArray = (more + less) / 2
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleCorrection:
    """Rotation that a servo corrects, all of it, while it is outside a tolerance."""

    within_rad: float
    start_rad: float  # standard deviation before the first look
    sigma_rad: float  # after a correction, one sigma

    @property
    def inside(self) -> float:
        """Return the probability that a correction ends inside."""
        return inside_angle(self.within_rad, self.sigma_rad)

    @property
    def turns(self) -> float:
        """Return the probability that the first look finds it outside."""
        return 1.0 - inside_angle(self.within_rad, self.start_rad)

    @property
    def most(self) -> int:
        """Return 1 if the first look finds it outside in more than GIVE_UP of cases."""
        return int(self.turns > GIVE_UP)

    @property
    def expected(self) -> float:
        """Return the mean number of corrections, each that ends outside repeated."""
        return self.turns / self.inside if self.inside > 0 else math.inf
