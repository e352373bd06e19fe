"""Probability that a normal error of any covariance lands beyond a circle.

Across the narrow principal axis Gauss nodes, along the wide one the complementary error
function: with u the offset along the narrow axis in its sigmas and h(u) the half chord
of the circle there,

    P(|e| >= r) = P(|x| >= r) + int phi(u) P(|y| >= h(u)) du.

All terms are positive, so tails keep their digits; pieces end where either factor
turns, so any ratio of the axes will do, and either may be zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.quadrature import (
    cuts_between,
    nodes_between,
    nodes_between_roots,
)

# exp(-40**2 / 2) = 1e-348 is no double.
TAIL_SIGMAS = 40.0
NODES = 16  # per piece, over which the exponents change by up to 40 each
# A sigma below this share of the other lengths moves no digit of the probability.
NEGLIGIBLE = 1e-15
# Principal sigmas closer than this are one: its effect is below the rounding of 1.
SAME = 1e-15
# Ends of pieces of the radii's distribution from its least radius on, in narrow or wide
# sigmas.
RADIUS_CUTS = np.array([0.02, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 9.0])
RADIUS_NODES = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneNormal:
    """A normal distribution in the plane: its mean and its covariance."""

    middle_um: tuple[float, float] = (0.0, 0.0)
    xx_um2: float
    xy_um2: float = 0.0
    yy_um2: float

    def __post_init__(self) -> None:
        numbers = (*self.middle_um, self.xx_um2, self.xy_um2, self.yy_um2)
        if not all(math.isfinite(value) for value in numbers):
            raise ValueError(f"a spread holds finite numbers only, got {numbers}")
        most = math.sqrt(max(self.xx_um2, 0.0)) * math.sqrt(max(self.yy_um2, 0.0))
        rounding = 1e-12 * max(self.xx_um2, self.yy_um2)  # of sums of u u^T
        off = abs(self.xy_um2) > most + rounding
        if self.xx_um2 < 0 or self.yy_um2 < 0 or off:
            raise ValueError(f"no covariance: {numbers[2:]} um2")

    @classmethod
    def along(cls, sigma_um: float, angle_rad: float | None) -> PlaneNormal:
        """Return a normal error along one direction, or isotropic where it is None."""
        if angle_rad is None:
            return cls(xx_um2=sigma_um**2, yy_um2=sigma_um**2)
        c, s = sigma_um * math.cos(angle_rad), sigma_um * math.sin(angle_rad)
        return cls(xx_um2=c * c, xy_um2=c * s, yy_um2=s * s)

    def plus(self, other: PlaneNormal) -> PlaneNormal:
        """Return the distribution of the sum of two independent errors."""
        return PlaneNormal(
            middle_um=(
                self.middle_um[0] + other.middle_um[0],
                self.middle_um[1] + other.middle_um[1],
            ),
            xx_um2=self.xx_um2 + other.xx_um2,
            xy_um2=self.xy_um2 + other.xy_um2,
            yy_um2=self.yy_um2 + other.yy_um2,
        )

    @property
    def principal(self) -> tuple[float, float, float]:
        """Return the narrow and the wide sigma, um, and the wide one's angle, rad."""
        half, skew = (self.xx_um2 - self.yy_um2) / 2, self.xy_um2
        reach = math.hypot(half, skew)
        wide = (self.xx_um2 + self.yy_um2) / 2 + reach
        # the product of both variances is the determinant: no difference of large terms
        # where one axis is the world's
        product = max(self.xx_um2 * self.yy_um2 - skew * skew, 0.0)
        narrow = min(product / wide, wide) if wide > 0 else 0.0
        angle = math.atan2(skew, half) / 2
        return math.sqrt(narrow), math.sqrt(wide), angle


def beyond_circle(radius_um: float, spread: PlaneNormal) -> float:
    """Return P(|e| >= radius_um) for a normal error.

    Parameters
    ----------
    radius_um : float
        Where it is not positive, every error is beyond.
    spread : PlaneNormal
        Law of the error.

    Returns
    -------
    float
        In 0..1. Small probabilities keep their digits, of a miss as of a hit.

    Raises
    ------
    ValueError
        If the radius is not finite.

    References
    ----------
    Isotropic about 0 it is Rayleigh's exp(-r**2 / (2 s**2)); isotropic about another
    middle it is Rice's distribution, the tail of a non-central chi square of two
    degrees.
    """
    miss, _ = _both(np.array([_finite(radius_um)]), spread)
    return float(miss[0])


def within_circle(radius_um: float, spread: PlaneNormal) -> float:
    """Return P(|e| < radius_um), its own digits kept where it is small."""
    _, hit = _both(np.array([_finite(radius_um)]), spread)
    return float(hit[0])


def beyond_radii(
    radius_um: float, flat_um: float, reach_um: float, spread: PlaneNormal
) -> float:
    """Return the probability of an error beyond a radius that varies.

    Parameters
    ----------
    radius_um : float
        Middle of the radius.
    flat_um, reach_um : float
        Its distribution is a trapezoid about the middle: level out to `flat_um`,
        nothing beyond `reach_um`.
    spread : PlaneNormal
        Law of the error.

    Returns
    -------
    float
        In 0..1, as `beyond_circle` gives it.
    """
    if reach_um <= 0:
        return beyond_circle(radius_um, spread)
    narrow, wide, _ = spread.principal
    steps = np.concatenate([RADIUS_CUTS * narrow, RADIUS_CUTS * wide])
    kinks = np.array([-flat_um, flat_um])
    edge = max(-reach_um, -radius_um)
    cuts = cuts_between(-reach_um, np.concatenate([kinks, edge + steps]), reach_um)
    deviation, weight = nodes_between(cuts, RADIUS_NODES)
    slope = max(reach_um - flat_um, 0.0)
    left = reach_um - np.abs(deviation)
    share = np.minimum(left / slope, 1.0) if slope > 0 else np.ones_like(left)
    law = weight * share
    miss, hit = _both(radius_um + deviation, spread)
    total = float(law.sum())
    missed, held = float(law @ miss) / total, float(law @ hit) / total
    return missed if missed < held else min(1.0, max(0.0, 1 - held))


def _finite(radius_um: float) -> float:
    if not math.isfinite(radius_um):
        raise ValueError(f"a radius must be finite, got {radius_um}")
    return radius_um


def _both(radii_um: FloatArray, spread: PlaneNormal) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities beyond and within each radius, (N,) each."""
    narrow, wide, angle = spread.principal
    x, y = spread.middle_um
    along = abs(x * math.cos(angle) + y * math.sin(angle))
    across = abs(y * math.cos(angle) - x * math.sin(angle))
    scale = wide + math.hypot(x, y)
    found = np.empty((2, len(radii_um)))
    for index, radius in enumerate(radii_um):
        found[:, index] = _pair(float(radius), (across, along), narrow, wide, scale)
    return found[0], found[1]


def _pair(
    radius_um: float,
    middle_um: tuple[float, float],
    narrow_um: float,
    wide_um: float,
    scale_um: float,
) -> tuple[float, float]:
    """Return P beyond and P within; `middle_um` across and along, >= 0."""
    across, along = middle_um
    if radius_um <= 0:
        return 1.0, 0.0
    if wide_um <= NEGLIGIBLE * (radius_um + math.hypot(across, along)):
        hit = float(math.hypot(across, along) < radius_um)
        return 1 - hit, hit
    if across == along == 0 and wide_um - narrow_um <= SAME * wide_um:
        exponent = -((radius_um / wide_um) ** 2) / 2
        return math.exp(exponent), -math.expm1(exponent)
    if narrow_um <= NEGLIGIBLE * (radius_um + scale_um):
        return _on_line(radius_um, across, along, wide_um)
    return _on_plane(radius_um, across, along, (narrow_um, wide_um))


def _on_line(
    radius_um: float, across_um: float, along_um: float, sigma_um: float
) -> tuple[float, float]:
    """Return both probabilities of an error on a line `across_um` from the middle."""
    if across_um >= radius_um:
        return 1.0, 0.0
    half = math.sqrt((radius_um - across_um) * (radius_um + across_um))
    out, inside = _chord(np.array([half]), along_um, sigma_um)
    return float(out[0]), float(inside[0])


def _on_plane(
    radius_um: float,
    across_um: float,
    along_um: float,
    sigmas_um: tuple[float, float],
) -> tuple[float, float]:
    """Return both probabilities; the offset across is across_um + narrow u."""
    narrow, wide = sigmas_um
    gap = radius_um - across_um
    low, high = -(radius_um + across_um) / narrow, gap / narrow
    first = min(max(low, -TAIL_SIGMAS), TAIL_SIGMAS)
    last = min(max(high, -TAIL_SIGMAS), TAIL_SIGMAS)
    outer = (special.erfc(high / math.sqrt(2)) + special.erfc(-low / math.sqrt(2))) / 2
    if last <= first:
        return min(1.0, float(outer)), 0.0
    u, weight = nodes_between_roots(
        cuts_between(first, _turns(radius_um, across_um, along_um, sigmas_um), last),
        NODES,
    )
    # the distance to the circle's end keeps its digits where u is a difference
    below, above = radius_um + across_um + narrow * u, gap - narrow * u
    half = np.sqrt(np.maximum(below, 0.0) * np.maximum(above, 0.0))
    law = weight * np.exp(-u * u / 2) / math.sqrt(2 * math.pi)
    out, inside = _chord(half, along_um, wide)
    miss, hit = float(outer + law @ out), float(law @ inside)
    total = miss + hit  # 1 up to the quadrature
    return min(1.0, miss / total), min(1.0, hit / total)


def _turns(
    radius_um: float,
    across_um: float,
    along_um: float,
    sigmas_um: tuple[float, float],
) -> FloatArray:
    """Return the ends of pieces: each narrow sigma, each wide sigma of the chord."""
    narrow, wide = sigmas_um
    body = np.arange(-TAIL_SIGMAS, TAIL_SIGMAS + 1)
    chord = np.clip(along_um + body * wide, 0.0, radius_um)
    side = np.sqrt((radius_um - chord) * (radius_um + chord))
    # near the circle's ends the chord is short: r - side without cancellation
    short = chord**2 / (radius_um + side)
    right = (radius_um - across_um - short) / narrow
    left = (short - radius_um - across_um) / narrow
    return np.concatenate([body, left, right])


def _chord(
    half_um: FloatArray, along_um: float, sigma_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return P(|y| >= half) and P(|y| < half) of y about `along_um` >= 0, (N,) each."""
    upper = (half_um - along_um) / (sigma_um * math.sqrt(2))
    lower = (half_um + along_um) / (sigma_um * math.sqrt(2))
    out = (special.erfc(upper) + special.erfc(lower)) / 2
    # erfc(-upper) - erfc(lower) cancels only where both are near 2 or the chord short
    inside = np.where(
        upper < 0,
        (special.erfc(-upper) - special.erfc(lower)) / 2,
        (special.erf(upper) + special.erf(lower)) / 2,
    )
    return out, np.maximum(inside, 0.0)
