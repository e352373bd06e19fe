"""Density of the miss probability over an error, for radii that vary.

Q(w, C) is the probability that a normal rest carries an error of size w beyond a circle
of radius C. Its slope dQ/dw, averaged over C, is a bump about as wide as the rest and
the distribution of C together. It does not depend on where the error comes from, so
that it is tabulated once for all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.quadrature import cuts_between, nodes_between
from microplan.planner.budget.probability.servo_landing import BODY_SIGMAS

# exp(-40**2 / 2) = 1e-348 is no double.
TAIL_SIGMAS = 40.0
RADIUS_NODES = 10  # per piece of the radii's distribution
# Ends of the pieces of the radii's distribution, in sigmas from where it counts most:
# close, because there it may fall as fast as exp(-TAIL_SIGMAS u).
NEAR_CUTS = np.array([0.25, 1.0, 2.5, 5.0, BODY_SIGMAS])
# The logarithm of the bump is a polynomial of this degree on pieces of one sigma, and
# of twice their distance from a kink beyond. Its nearest singularities are the zeros
# of erfc-like functions, 2 sigmas off: 8**-18 = 5e-17 of it is left.
DEGREE = 17
KEPT = 64  # bumps, of about 0.3 MB each


@dataclass(frozen=True, slots=True, kw_only=True)
class VaryingRadius:
    """Distribution of a radius: the difference of two sizes, each uniform.

    A trapezoid about `radius_um`: level out to `flat_um`, nothing beyond `reach_um`.
    """

    radius_um: float
    flat_um: float
    reach_um: float

    def density(self, deviation_um: FloatArray) -> FloatArray:
        """Return the density, (...) per um, of deviations from it, (...) um."""
        slope = self.reach_um - self.flat_um
        left = self.reach_um - np.abs(deviation_um)
        share = np.minimum(left / slope, 1.0) if slope > 0 else np.ones_like(left)
        density: FloatArray = np.maximum(share, 0.0) / (self.reach_um + self.flat_um)
        return density

    @property
    def kinks_um(self) -> FloatArray:
        """Return the kinks of the density, (4,) um."""
        return np.array([-self.reach_um, -self.flat_um, self.flat_um, self.reach_um])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissDensity:
    """dQ/dw over w = radius + offset, as polynomials of log (dQ/dw / w) on pieces."""

    radius_um: float
    cuts_um: FloatArray  # (K + 1,) ends of the pieces, of the offset
    terms: FloatArray  # (DEGREE + 1, K) Chebyshev coefficients

    def at(self, offset_um: FloatArray) -> FloatArray:
        """Return dQ/dw at w = radius + offset, per um, same shape (N,)."""
        piece = np.searchsorted(self.cuts_um, offset_um, side="right") - 1
        piece = np.clip(piece, 0, len(self.cuts_um) - 2)
        low, high = self.cuts_um[piece], self.cuts_um[piece + 1]
        place = ((offset_um - low) - (high - offset_um)) / (high - low)
        terms = self.terms[:, piece]
        slope: FloatArray = np.exp(_clenshaw(terms, place))
        return slope * (self.radius_um + offset_um)


@lru_cache(maxsize=KEPT)
def miss_density(room: VaryingRadius, sigma_um: float) -> MissDensity:
    """Return the miss density of a rest of `sigma_um` > 0 per axis.

    It reaches from where dQ/dw is no double to BODY_SIGMAS beyond the largest radius.

    References
    ----------
    dQ/dw = C / s**2 exp(-(w**2 + C**2) / (2 s**2)) I1(w C / s**2) for the Rice
    distribution's tail Q(w, C): Marcum's function of first order.
    """
    cuts = _cuts(room, sigma_um)
    angle = math.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1)
    share = (1 + np.cos(angle)) / 2
    nodes = cuts[:-1] + share[:, None] * np.diff(cuts)
    values = _log_slope(room, sigma_um, nodes.ravel()).reshape(nodes.shape)
    basis = np.cos(np.arange(DEGREE + 1)[:, None] * angle) * 2 / (DEGREE + 1)
    basis[0] /= 2
    return MissDensity(radius_um=room.radius_um, cuts_um=cuts, terms=basis @ values)


def radii_near(
    room: VaryingRadius, sigma_um: float, offset_um: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return radii less w = radius + offset, (N, M) um, and weights, (N, M)."""
    if room.reach_um == 0:
        return -offset_um[:, None], np.ones((len(offset_um), 1))
    low = max(-room.reach_um, -room.radius_um) - offset_um
    high = room.reach_um - offset_um
    likely = np.clip(0.0, low, high)[:, None]
    near = np.concatenate([-NEAR_CUTS[::-1], [0.0], NEAR_CUTS]) * sigma_um
    cuts = np.concatenate(
        [likely + near, room.kinks_um - offset_um[:, None], low[:, None]], axis=1
    )
    cuts = np.sort(np.clip(cuts, low[:, None], high[:, None]), axis=1)
    wide, weight = nodes_between(cuts, RADIUS_NODES)
    return wide, weight * room.density(wide + offset_um[:, None])


def _cuts(room: VaryingRadius, sigma_um: float) -> FloatArray:
    """Return the ends of the pieces: close to kinks, wider away from them."""
    low = max(-room.radius_um, -room.reach_um - TAIL_SIGMAS * sigma_um)
    high = room.reach_um + BODY_SIGMAS * sigma_um
    near = np.arange(0.0, BODY_SIGMAS + 1)
    count = max(math.ceil(math.log2((high - low) / sigma_um)), 4)
    far = BODY_SIGMAS * 2.0 ** np.arange(1, count)
    steps = np.concatenate([-far[::-1], -near[::-1], near, far]) * sigma_um
    tail = np.arange(-TAIL_SIGMAS, 0.0) * sigma_um
    edges = room.kinks_um if room.reach_um > sigma_um else np.zeros(1)
    edges = np.append(edges, low)  # where radii end at 0, it bends within a sigma
    return cuts_between(
        low, np.concatenate([(edges[:, None] + steps).ravel(), tail - room.reach_um]),
        high,
    )  # fmt: skip


def _log_slope(
    room: VaryingRadius, sigma_um: float, offset_um: FloatArray
) -> FloatArray:
    """Return log (dQ/dw / w) at w = radius + offset > 0, (N,)."""
    wide, weight = radii_near(room, sigma_um, offset_um)
    w = (room.radius_um + offset_um)[:, None] / sigma_um
    radius = w + wide / sigma_um
    exponent = -((wide / sigma_um) ** 2) / 2
    least = exponent.max(axis=1, keepdims=True)
    law = weight * radius**2 * _bessel(w * radius) * np.exp(exponent - least)
    slope: FloatArray = np.log(law.sum(axis=1) / sigma_um**2) + least[:, 0]
    return slope


def _bessel(x: FloatArray) -> FloatArray:
    """Return exp(-x) I1(x) / x, 1/2 at 0, same shape."""
    found: FloatArray = np.divide(
        special.i1e(x), x, out=np.full_like(x, 0.5), where=x > 0
    )
    return found


def _clenshaw(terms: FloatArray, place: FloatArray) -> FloatArray:
    """Return Chebyshev sums, (D, N) coefficients at (N,) positions in -1..1."""
    after = later = np.zeros_like(place)
    for row in terms[:0:-1]:
        after, later = row + 2 * place * after - later, after
    total: FloatArray = terms[0] + place * after - later
    return total
