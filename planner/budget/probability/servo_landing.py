"""Distribution of a servo's residual, with the looks that it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.quadrature import nodes_between

MOST_LOOKS = 10_000  # after which the rest is taken as alike
_SETTLED = 1e-12  # change of a probability from look to look


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """A servo loop in two axes alike; errors are one sigma per axis."""

    gain: float
    move_um: float  # of where axes land about their reading
    look_um: float  # of what a look says
    start_um: float  # of the first look's true error, its landing among it
    within_um: float  # distance at which a look ends it


def expected_looks(loop: Loop) -> float:
    """Return the mean number of looks of a servo, inf if none is ever inside.

    A look sees m = a + w: what the readings are off by, a, and what is new each time,
    w, the landing and the look's own error. Outside the tolerance T the readings go by
    -g m, so that a+ = a - g m. With variances A and W per axis, M = A + W, a look ends
    it with 1 - exp(-T**2 / (2 M)). What goes on has E m**2 = M + T**2 / 2 per axis, and
    of it a is A / M m with variance A W / M; hence

        A+ = (A / M - g)**2 (M + T**2 / 2) + A W / M.

    What goes on is taken as normal again, which errs by up to 5 % of the looks at gains
    up to 1, the largest a plan has, and by 8 % at 1.4.
    """
    new = loop.move_um**2 + loop.look_um**2
    off = max(loop.start_um**2 - loop.move_um**2, 0.0)
    square = loop.within_um**2
    looks, going, before = 0.0, 1.0, -1.0
    for _ in range(MOST_LOOKS):
        seen = off + new
        if seen <= 0:
            return looks + going
        ends = -math.expm1(-square / (2 * seen))
        if abs(ends - before) <= _SETTLED * ends:
            break
        looks, going, before = looks + going, going * (1 - ends), ends
        if going <= 0:
            return looks
        share = off / seen
        off = (share - loop.gain) ** 2 * (seen + square / 2) + share * new
    return looks + going / ends if ends > 0 else math.inf


# exp(-9**2 / 2) = 3e-18 is lost in the rounding of 1.
BODY_SIGMAS = 9.0
STEP_SIGMAS = 2.0  # length of a piece along the radius
TAIL_STEP_SIGMAS = 1.0  # where the tail falls by up to exp(-40) over it
# Ends of the pieces around the circle, as shares of the BODY_SIGMAS that count.
CIRCLE_CUTS = np.array([0.0, 2.0, 5.0, 9.0]) / 9.0
NODES = 16  # per piece


@dataclass(frozen=True, slots=True, kw_only=True)
class Landing:
    """Landing of a servo: a bias, a normal error cut off at `within_um`."""

    bias_um: float
    sigma_um: float
    within_um: float

    def breaks_um(self) -> FloatArray:
        """Return the kinks of `beyond`, and steps where it is steep, (N,) um."""
        b, reach, sigma = self.bias_um, self.within_um, self.sigma_um
        if reach == 0:
            return np.array([b])
        body = np.arange(-BODY_SIGMAS, BODY_SIGMAS + 1, STEP_SIGMAS) * sigma
        tail = np.arange(BODY_SIGMAS, reach / sigma, TAIL_STEP_SIGMAS) * sigma
        steps = np.clip(np.concatenate([body, tail]), -reach, reach)
        return np.concatenate([b + steps, [abs(reach - b), b, reach + b]])

    def beyond(self, radius_um: float, offset_um: FloatArray) -> FloatArray:
        """Return P(W >= radius_um + offset_um), same shape as `offset_um`, (N,).

        The radius comes in two parts so that its distance from the bias keeps its
        digits. By the divergence theorem the probability inside a circle of radius a is
        the mean over its points p of F(|p - b|) (1 + (a**2 - b**2) / |p - b|**2) / 2, F
        the cumulated distribution of |m|: F's share beyond `within_um` is a Poisson
        kernel and has a closed form. Far outside the complement of F gives the
        probability beyond at once.
        """
        a, gap = radius_um + offset_um, (radius_um - self.bias_um) + offset_um
        if self.within_um == 0:
            return (gap <= 0).astype(np.float64)
        if self.bias_um == 0:
            return self._outside(a**2)
        found = np.empty_like(a)
        far = gap > self.sigma_um
        found[far] = self._far(a[far], gap[far])
        found[~far] = 1 - self._near(a[~far], gap[~far])
        return found

    def _far(self, a: FloatArray, gap: FloatArray) -> FloatArray:
        """Return P(W >= a) where a - b = gap > 0, digits kept; (N,)."""
        square, weight, _ = self._circle(a, gap)
        kernel = 1 + (gap * (a + self.bias_um))[:, None] / square
        chance: FloatArray = (weight * self._outside(square) * kernel).sum(axis=1)
        return chance / (2 * math.pi)

    def _near(self, a: FloatArray, gap: FloatArray) -> FloatArray:
        """Return P(W < a) where a - b = gap, (N,)."""
        square, weight, end = self._circle(a, gap)
        rise = self._per_square(square)
        kernel = (
            np.minimum(rise * square, 1.0) + rise * (gap * (a + self.bias_um))[:, None]
        )
        rest = math.pi - end
        rest += 2 * np.arctan2(gap, (a + self.bias_um) * np.tan(end / 2))
        chance: FloatArray = (weight * kernel).sum(axis=1) + rest
        return chance / (2 * math.pi)

    def _circle(
        self, a: FloatArray, gap: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return |p - b|**2 and weights on half a circle, (N, M), and the end, (N,).

        Up to the angle where the distribution of |m| has run out.
        """
        left = np.sqrt(np.maximum((self.within_um - gap) * (self.within_um + gap), 0.0))
        width = 2 * np.sqrt(a * self.bias_um)
        reach = np.minimum(left, BODY_SIGMAS * self.sigma_um)
        whole = (reach > 0).astype(np.float64)  # a width may be too small for a double
        share = np.divide(reach, width, out=whole, where=reach < width)
        end = 2 * np.arcsin(share)
        angle, weight = nodes_between(end[:, None] * CIRCLE_CUTS, NODES)
        across = width[:, None] * np.sin(angle / 2)
        return gap[:, None] ** 2 + across**2, weight, end

    def _exponents(self, square: FloatArray) -> tuple[FloatArray, float]:
        """Return the normal exponents at `square` and at its end."""
        q = np.sqrt(square) / self.sigma_um
        ratio = self.within_um / self.sigma_um
        return q * q / 2, ratio * ratio / 2

    def _per_square(self, square: FloatArray) -> FloatArray:
        """Return P(|m|**2 < square) / square up to the cut-off."""
        q, last = self._exponents(square)
        scale = self.within_um**2 * float(special.exprel(-last))
        rise: FloatArray = special.exprel(-q) / scale
        return rise

    def _outside(self, square: FloatArray) -> FloatArray:
        """Return P(|m|**2 >= square)."""
        q, last = self._exponents(np.minimum(square, self.within_um**2))
        left = np.maximum(1 - square / self.within_um**2, 0.0)
        tail: FloatArray = left * np.exp(-q) * special.exprel(q - last)
        return tail / float(special.exprel(-last))
