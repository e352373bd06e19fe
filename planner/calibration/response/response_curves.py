"""Curves of the light over the level: a power, or a power with bends.

References
----------
Debevec & Malik (1997), Recovering high dynamic range radiance maps from photographs,
eqs. (1)-(3): the logarithm of the light over the level, here as a power with a smooth
correction, each pixel's exposure eliminated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from microplan.arrays import FloatArray
from microplan.optics.lens.sensor import ROUNDING
from microplan.planner.calibration.estimates import jackknife_covariance
from microplan.planner.calibration.response.light_levels import (
    CLEAR,
    LightLevels,
    weighted,
)

POWERS = (0.1, 5.0)  # beyond it is no camera
_ODD = 5.0  # times the usual misfit: a pixel that moved or is defective
_CHANGE = 0.01  # of a reading: small against its range, large against fits' ends
_CHANCE = 6.0  # standard deviations that no level of thousands is off by
_KNOTS = 8  # of the correction
_ROWS = 17  # of a table
_LARGE = 10.0  # noise below 1/10 of the level bends its logarithm by less than .5 %


@dataclass(frozen=True, slots=True, kw_only=True)
class LightCurve:
    """Logarithm of the light over the level, up to a constant."""

    black: float
    gamma: float
    knots: FloatArray  # (M,) counts
    bends: FloatArray  # (M,) added to the power's; zeros: a power

    def log_light(self, counts: FloatArray) -> FloatArray:
        """Return the logarithm of the light at counts (...) above black.

        Below the knots it goes on as the power, above them as the last piece.
        """
        bend = _hats(self.knots, counts) @ self.bends
        return np.log(np.maximum(counts - self.black, 1e-9)) / self.gamma + bend


def power_curve(levels: LightLevels, start: LightCurve | None = None) -> LightCurve:
    """Return the power with which the levels of each pixel rise over the light."""
    most, least = float(levels.means.max()), _darkest(levels)

    def residuals(numbers: FloatArray) -> FloatArray:
        return _misfits((numbers[0], numbers[1] * most), levels)[0].ravel()

    low, high = np.log(POWERS)
    first = [-0.2, min(0.0, 0.5 * least / most)]
    if start is not None:
        first = [math.log(start.gamma), min(start.black, least) / most]
    best = least_squares(
        residuals,
        np.array(first),
        bounds=([low, -2.0], [high, least / most + 1e-6]),
        x_scale=[0.1, 0.05],
    )
    log_gamma, black = best.x
    none = np.zeros(1)
    return LightCurve(
        black=float(black * most), gamma=math.exp(log_gamma), knots=none, bends=none
    )


def _darkest(levels: LightLevels) -> float:
    """Return the count that no black level exceeds, by the darkest levels' noise."""
    variance = levels.sigmas**2 / levels.frames + ROUNDING
    above = levels.means + _CHANCE * np.sqrt(variance)
    return float(above[levels.weights > 0].min())


def common_errors(levels: LightLevels, power: LightCurve) -> FloatArray:
    """Return variances of a power's gamma and black if all readings err alike, (2,).

    The share by which readings err is that by which levels of whole steps are off; how
    it moves the power, what the power does if one reading is changed. [1], counts
    squared.
    """
    moved = []
    for light, reading in enumerate(levels.lights.tolist()):
        lights = levels.lights.copy()
        lights[light] = reading * (1 + _CHANGE)
        other = power_curve(replace(levels, lights=lights), power)
        moved.append([other.gamma - power.gamma, other.black - power.black])
    _, exposures = _misfits((math.log(power.gamma), power.black), levels)
    rise = exposures[:, None] * levels.lights**power.gamma
    off, slope = levels.means - power.black - rise, power.gamma * rise
    norm = ((levels.weights * slope) ** 2).sum(axis=0)
    errors = (levels.weights**2 * slope * off).sum(axis=0) / np.maximum(norm, 1e-300)
    free = max(int((norm > 0).sum()) - 3, 1)  # gamma, black, a common exposure
    found: FloatArray = np.sum(np.square(moved), axis=0) / _CHANGE**2
    return found * float(np.sum(errors[norm > 0] ** 2)) / free


def cleared(levels: LightLevels, curve: LightCurve, white: float) -> LightLevels:
    """Return levels chosen by what is expected of them: chance shifts no choice.

    Without pixels that do not follow: those that moved or are defective.
    """
    off, exposures = _misfits((math.log(curve.gamma), curve.black), levels)
    used = np.maximum((levels.weights > 0).sum(axis=1), 1)
    misfit = np.sqrt((off**2).sum(axis=1) / used)
    follows = misfit <= _ODD * max(float(np.median(misfit)), 1e-6)
    expected = curve.black + exposures[:, None] * levels.lights**curve.gamma
    margin = CLEAR * levels.sigmas
    clear = (expected > margin) & (expected < white - margin)
    return weighted(levels, clear & follows[:, None])


def _misfits(
    numbers: tuple[float, float], levels: LightLevels
) -> tuple[FloatArray, FloatArray]:
    """Return weighted misfits (N, K) of a power and the best exposures (N,), counts."""
    log_gamma, black = numbers
    rise = levels.lights ** math.exp(log_gamma)
    weights, above = levels.weights, levels.means - black
    squares = (weights * rise) ** 2
    norm = squares.sum(axis=1)
    exposures = (weights**2 * rise * above).sum(axis=1) / np.where(norm > 0, norm, 1.0)
    return weights * (above - exposures[:, None] * rise), exposures


def table_curve(levels: LightLevels, power: LightCurve) -> LightCurve:
    """Return the power with bends that make the pixels' exposures agree best."""
    lights = levels.lights
    dark = levels.weights[:, lights == 0]
    black = power.black
    if dark.any():
        black = float(np.average(levels.means[:, lights == 0], weights=dark**2))
    start = replace(power, black=black)
    weights = log_weights(levels, start)
    inside = levels.means[weights > 0]
    if not inside.size or np.ptp(inside) < _KNOTS:  # counts: no more than one a knot
        return start
    ends = np.log(np.array([inside.min(), inside.max()]) - black)
    knots = black + np.exp(np.linspace(ends[0], ends[1], _KNOTS))  # even in the power
    hats = _hats(knots, levels.means)
    log_light = start.log_light(levels.means) - log_of(lights)
    norm = np.maximum((weights**2).sum(axis=1), 1e-300)
    mean = (weights**2 * log_light).sum(axis=1) / norm
    means = (weights[..., None] ** 2 * hats).sum(axis=1) / norm[:, None]
    design = (weights[..., None] * (hats - means[:, None])).reshape(-1, _KNOTS)
    target = -(weights * (log_light - mean[:, None])).ravel()
    smooth = np.diff(np.eye(_KNOTS), 2, axis=0) * 1e-3 * np.linalg.norm(design)
    rows = np.concatenate((design, smooth))
    target = np.concatenate((target, np.zeros(len(smooth))))
    bends = np.linalg.lstsq(rows, target, rcond=None)[0]
    return replace(start, knots=knots, bends=bends)


def log_weights(levels: LightLevels, curve: LightCurve) -> FloatArray:
    """Return weights of the light's logarithm [1], (N, K); 0 where counts are dark."""
    above = np.maximum(levels.means - curve.black, 0.0)
    use = (levels.weights * above > _LARGE) & (levels.lights > 0)
    return np.where(use, levels.weights * curve.gamma * above, 0.0)


def rows_of(curve: LightCurve, white: float) -> tuple[tuple[float, float], ...] | None:
    """Return rows of light and level; None if the light does not rise with the level.

    Between the knots as well, where rows are sparse.
    """
    fine = np.linspace(0.0, 1.0, 32 * (_ROWS - 1) + 1)
    counts = curve.black + (white - curve.black) * fine[1:]
    off = curve.log_light(counts) - curve.log_light(counts[-1:])
    light = np.exp(np.minimum(off, 1.0))  # above 0 it does not rise to the last
    if not (np.diff(light, prepend=0.0) > 0).all():
        return None
    shares = np.concatenate((np.zeros(1), light))[::32]
    return tuple(zip(shares.tolist(), fine[::32].tolist(), strict=True))


def row_sigmas(
    rows: tuple[tuple[float, float], ...], tables: Sequence[LightCurve], white: float
) -> tuple[float | None, ...]:
    """Return the deviations of rows' levels at their lights."""
    shares = np.array([share for share, _ in rows])
    without = []
    for table in tables if rows else ():
        own = np.array(rows_of(table, white) or [(0.0, math.nan)])
        without.append(np.interp(shares, own[:, 0], own[:, 1]))
    covariance = jackknife_covariance(without)
    if covariance is None:
        return tuple(None for _ in rows)
    return tuple(np.sqrt(np.diag(covariance)).tolist())


def log_of(lights: FloatArray) -> FloatArray:
    """Return logarithms [1] of lights (K,); of darkness a small one, not used."""
    return np.log(np.maximum(lights, 1e-300))


def _hats(knots: FloatArray, counts: FloatArray) -> FloatArray:
    """Return what each knot adds at counts (...), (..., M): a natural cubic spline.

    Below the knots as at the first, above them straight on.
    """
    if knots.size < 2:
        return np.zeros((*np.shape(counts), knots.size))
    spline = CubicSpline(knots, np.eye(knots.size), bc_type="natural")
    inside = np.clip(counts, knots[0], knots[-1])
    beyond = np.maximum(counts - knots[-1], 0.0)[..., None]
    found: FloatArray = spline(inside) + beyond * spline(knots[-1], 1)
    return found
