"""Tail of an error that is alike in all directions: cut-off residual, normal rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import interpolate, special

from microplan.arrays import FloatArray
from microplan.planner.budget.probability.fit_probability import Residual

BODY_SIGMAS = 9.0  # exp(-9**2 / 2) = 3e-18 is lost in the rounding of 1
KNOTS, FINE = 600, 6000  # of the density, and of the table that is read linearly
# A rest narrower than this share of the cut-off is taken as wide: its effect is the
# square of that.
LEAST_SHARE = 0.01
NODES_PER_SIGMA = 6.0  # of the rest, over the radius of the residual


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RadialLaw:
    """P(|e| >= r) on a grid of radii, and P(|e| < r) / r**2."""

    reach_um: float  # beyond which the tail is lost
    scale_um: float  # over which both change
    radius_um: FloatArray  # (N,)
    log_tail: FloatArray  # (N,)
    per_square: FloatArray  # (N,) per um2

    def tail(self, radius_um: FloatArray) -> FloatArray:
        """Return P(|e| >= r) at radii, (...) [1]."""
        found: FloatArray = np.exp(np.interp(radius_um, self.radius_um, self.log_tail))
        return found

    def density(self, radius_um: FloatArray) -> FloatArray:
        """Return P(|e| < r) / r**2, (...) per um2, at radii."""
        found: FloatArray = np.interp(radius_um, self.radius_um, self.per_square)
        return found


@lru_cache(maxsize=64)
def radial_law(residual: Residual, sigma_um: float) -> RadialLaw:
    """Return the law of a cut-off residual plus an isotropic normal rest.

    Parameters
    ----------
    residual : Residual
        Normal, cut off at a circle.
    sigma_um : float
        Of the rest per axis. One below LEAST_SHARE of the cut-off is taken as that.
    """
    left, within = residual.sigma_um, residual.within_um
    if left <= 0 or within <= 0 or math.isinf(within):
        return _normal(math.hypot(sigma_um, max(left, 0.0) if within > 0 else 0.0))
    most = min(within, BODY_SIGMAS * left)
    sigma_um = max(sigma_um, LEAST_SHARE * most)
    return _cut_off(left, most, sigma_um)


def _normal(sigma_um: float) -> RadialLaw:
    """Return Rayleigh's law."""
    reach = BODY_SIGMAS * sigma_um
    radius = np.linspace(0, reach, FINE)
    square = (radius / sigma_um) ** 2 / 2
    return RadialLaw(
        reach_um=reach, scale_um=sigma_um, radius_um=radius, log_tail=-square,
        per_square=special.exprel(-square) / (2 * sigma_um**2),
    )  # fmt: skip


def _cut_off(left_um: float, within_um: float, sigma_um: float) -> RadialLaw:
    """Return the law of Rayleigh's radius cut off at `within_um`, blurred.

    Its density is that of Rice, averaged over the residual's radius m,
    r / s**2 exp(-(r - m)**2 / (2 s**2)) i0e(r m / s**2).
    """
    reach = within_um + BODY_SIGMAS * sigma_um
    count = math.ceil(NODES_PER_SIGMA * max(within_um / sigma_um, within_um / left_um))
    node, weight = np.polynomial.legendre.leggauss(max(count, 16))
    m = within_um * (node + 1) / 2
    weight = weight * m * np.exp(-((m / left_um) ** 2) / 2)
    weight /= weight.sum()
    r = np.linspace(0, reach, KNOTS)[:, None]
    blur = np.exp(-(((r - m) / sigma_um) ** 2) / 2) * special.i0e(r * m / sigma_um**2)
    per_radius = (blur @ weight) / sigma_um**2  # density / r
    r = r[:, 0]
    density = interpolate.CubicSpline(r, r * per_radius)
    inside = density.antiderivative()
    fine = np.linspace(0, reach, FINE)
    beyond = interpolate.CubicSpline(r, (r * per_radius)[::-1]).antiderivative()
    tail = np.maximum(beyond(reach - fine) / beyond(reach), 1e-300)
    square = fine**2
    share = inside(fine) / inside(reach) / np.where(fine > 0, square, 1.0)
    first = fine < 2 * r[1]  # cancels
    share[first] = (
        interpolate.CubicSpline(r, per_radius)(fine[first] / math.sqrt(2)) / 2
    )
    # nothing of it is narrower than the rest: a residual much finer tells nothing
    scale = max(min(sigma_um, left_um), LEAST_SHARE * sigma_um)
    return RadialLaw(
        reach_um=reach, scale_um=scale, radius_um=fine,
        log_tail=np.log(np.minimum(tail, 1.0)), per_square=share,
    )  # fmt: skip
