"""Peak of a focus sweep, by mirror symmetry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure

_PAIRS = 48  # points compared either side of the mirror: many to a stop
_STEPS = 40  # of the mirror's search; it rests after about six
_STILL = 1e-9  # of the half width: the mirror is at rest
_LIFT = 0.05  # of the height: what scores near 0 are lifted by for their reciprocal
_DRAWN = 0.015  # of the width: the mirror's error by stops one width apart
_CLEARLY = 2.0  # times the known noise: above, the curve is no mirror image
# Student's interval that holds 68 % over the normal one's, by one over the freedom
_STUDENT = ((0.0, 0.1, 0.2, 1 / 3, 0.5, 1.0), (1.0, 1.053, 1.111, 1.197, 1.321, 1.837))
_FEWEST = 5  # stops in a sweep
_LEAST = 4  # of them on the peak: one more than a curve has numbers
_FOOT = 0.1  # of the height: neighbours of the upper half join in above this
_FLAT = 0.15  # of the highest score, the least the scores must vary by

Numbers = Sequence[float] | FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusPeak:
    """Where a sweep was sharpest."""

    z_um: float
    sigma_um: float  # one standard deviation, from how well the curve fits
    width_um: float  # standard deviation of a Gaussian as wide as the peak


@dataclass(frozen=True, slots=True)
class Hill:
    """A sweep that has one peak inside: stops z, um, and their scores s, (N,) each."""

    z: FloatArray
    s: FloatArray
    low: float
    high: float
    first: int  # of the upper half and what joins in
    last: int


@dataclass(frozen=True, slots=True)
class _Mirror:
    """Where a curve is its own mirror image, and what is left there."""

    top: float
    rows: FloatArray  # (D, N), what gives the differences from u at the stops
    r: FloatArray  # (D,) the differences
    slope: FloatArray  # (D,) of them in the top


def mirror_peak(
    z_um: Numbers, scores: Numbers, *, noise: float = 0.0
) -> FocusPeak | Failure:
    """Return the z0 about which the upper half is its own mirror image.

    A curve u through all stops is compared with its reflection, u(z0 + d) with
    u(z0 - d), for d up to half the width at half height; z0 makes the sum of squared
    differences least. No shape is supposed but that blur is even in defocus.

    Parameters
    ----------
    z_um : (N,) sequence of float
        Stops of the sweep, strictly rising, N >= 5.
    scores : (N,) sequence of float
        Sharpness at each.
    noise : float
        What is known of the standard deviation of a score, over the peak's height; 0 if
        nothing. A few stops tell little of it, so that sigma is wide without.

    Returns
    -------
    FocusPeak or Failure
        Fails with "few_stops", "flat", "border" (the peak is not inside the sweep),
        "several_peaks" (also where no mirror is found) or "coarse" (fewer than 4 stops
        on the peak). Sigma is by the known noise, unless the fit clearly shows more.

    Raises
    ------
    ValueError
        If the lengths differ, the stops do not rise, a value is not finite or the
        noise is negative.

    Notes
    -----
    u is the cubic spline through -1/s: a squared gradient falls as the blur widens, and
    the blur's width bends less than the peak, so that fewer stops draw it. Differences
    count relative to the mean of both sides, which makes more of the top where noise is
    less in u. They are linear in u's values at the stops, r = B u, so that values of
    one standard deviation each move z0 by |B^T r'| / |r'|^2, r' being dr/dz0. To that
    comes what the stops leave undrawn, `mirror_error_um`.
    """
    if not 0 <= noise < math.inf:
        raise ValueError(f"noise must be finite and >= 0, got {noise}")
    hill = find_hill(z_um, scores)
    if isinstance(hill, Failure):
        return hill
    height = hill.high - hill.low
    lift = max(hill.low / height, _LIFT)
    u = -1 / ((hill.s - hill.low) / height + lift)  # of the height: no score is tiny
    left, right = _half_height(hill, u, -1 / (0.5 + lift))
    mirror = _mirror(hill.z, u, left, right)
    if mirror is None:
        return Failure("several_peaks", "no mirror image is found")
    width = (right - left) / math.sqrt(8 * math.log(2))
    step = float(np.diff(hill.z[hill.first : hill.last + 1]).max())
    noise_um = _noise_um(mirror, noise * u**2)
    return FocusPeak(
        z_um=mirror.top,
        sigma_um=math.hypot(noise_um, mirror_error_um(step, width)),
        width_um=width,
    )


def mirror_error_um(step_um: float, width_um: float) -> float:
    """Return what the mirror fit errs by without noise, one standard deviation.

    Measured: it falls with the fifth power of the step at least, and the factor holds
    for squared gradients up to 1.15 widths, where stops become too few for a fit
    (figure `focus.mirror.undrawn_ratio`).
    """
    return _DRAWN * width_um * (step_um / width_um) ** 5


def _half_height(hill: Hill, u: FloatArray, level: float) -> tuple[float, float]:
    """Return where straight lines between stops cross half the height, um.

    u is nearly straight there.
    """
    # by scores, as `find_hill` has it: u rounds otherwise
    upper = np.flatnonzero(hill.s >= (hill.low + hill.high) / 2)
    crossings = []
    for inside, outside in ((upper[0], upper[0] - 1), (upper[-1], upper[-1] + 1)):
        share = (u[inside] - level) / (u[inside] - u[outside])
        crossings.append(hill.z[inside] + share * (hill.z[outside] - hill.z[inside]))
    return float(crossings[0]), float(crossings[1])


def _spline(z: FloatArray) -> FloatArray:
    """Return what gives the natural spline's second derivatives from scores, (N, N)."""
    n, h = len(z), np.diff(z)
    system, right = np.eye(n), np.zeros((n, n))
    for i in range(1, n - 1):
        system[i, i - 1 : i + 2] = h[i - 1] / 6, (h[i - 1] + h[i]) / 3, h[i] / 6
        right[i, i - 1 : i + 2] = 1 / h[i - 1], -1 / h[i - 1] - 1 / h[i], 1 / h[i]
    return np.asarray(np.linalg.solve(system, right))


def _mirror(z: FloatArray, u: FloatArray, left: float, right: float) -> _Mirror | None:
    """Return the mirror between two ends by Gauss and Newton's steps, None if none."""
    reach, spline = (right - left) / 2, _spline(z)
    away = reach * (np.arange(_PAIRS) + 0.5) / _PAIRS
    least = float(np.abs(u).min()) / 2  # a spline may rise above 0 between stops
    top = (left + right) / 2
    for _ in range(_STEPS):
        ahead, ahead_slope = _at(z, spline, top + away)
        behind, behind_slope = _at(z, spline, top - away)
        weight = 1 / np.maximum(-(ahead + behind) @ u / 2, least)[:, None]
        rows = (ahead - behind) * weight
        r, slope = rows @ u, (ahead_slope - behind_slope) * weight @ u
        move = -float(r @ slope) / float(slope @ slope)
        top = float(np.clip(top + move, left, right))
        if abs(move) < _STILL * reach:
            return _Mirror(top=top, rows=rows, r=r, slope=slope)
    return None


def _at(
    z: FloatArray, spline: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what gives the spline's value and slope at x from scores, (D, N) each."""
    i = np.clip(np.searchsorted(z, x) - 1, 0, len(z) - 2)
    h = (z[i + 1] - z[i])[:, None]
    b = (x - z[i])[:, None] / h
    a = 1 - b
    unit, lower, upper = np.eye(len(z)), spline[i], spline[i + 1]
    value = a * unit[i] + b * unit[i + 1]
    value = value + ((a**3 - a) * lower + (b**3 - b) * upper) * h**2 / 6
    slope = (unit[i + 1] - unit[i]) / h
    slope = slope + ((1 - 3 * a**2) * lower + (3 * b**2 - 1) * upper) * h / 6
    return value, slope


def _noise_um(mirror: _Mirror, known: FloatArray) -> float:
    """Return the standard deviation of the mirror, by what is known or by the fit.

    `known` are the standard deviations of u at the stops, (N,).
    """
    rows, r, slope = mirror.rows, mirror.r, mirror.slope
    squared = float(slope @ slope)
    pull = rows.T @ slope / squared  # of the top by each value of u
    sure = float(np.linalg.norm(pull * known))
    left = rows - np.outer(slope, slope @ rows) / squared
    spread = left.T @ left
    trace = float(np.trace(spread))  # the mean of |r|^2 over a value's variance
    freedom = trace**2 / float((spread**2).sum())  # Satterthwaite (1946)
    fitted = math.sqrt(float(r @ r) / trace) * float(np.linalg.norm(pull))
    if sure > 0 and fitted <= _CLEARLY * sure:
        return sure
    return fitted * float(np.interp(1 / max(freedom, 1.0), *_STUDENT))


def find_hill(z_um: Numbers, scores: Numbers) -> Hill | Failure:
    """Return the sweep if it has one peak inside, with enough stops on it."""
    z, s = np.array(z_um, dtype=np.float64), np.array(scores, dtype=np.float64)
    if z.shape != s.shape or z.ndim != 1:
        raise ValueError(f"need as many stops as scores, got {len(z)} and {len(s)}")
    if not (np.isfinite(z).all() and np.isfinite(s).all() and (np.diff(z) > 0).all()):
        raise ValueError("stops must rise and all values be finite")
    if len(z) < _FEWEST:
        return Failure("few_stops", f"{len(z)} stops, at least {_FEWEST}")
    low, high = float(s.min()), float(s.max())
    if high - low <= _FLAT * abs(high):
        return Failure(
            "flat", f"scores vary from {low:.4g} to {high:.4g}, by {_FLAT:.0%} at least"
        )
    upper = np.flatnonzero(s >= (low + high) / 2)
    problem = _shape(upper, len(z))
    if problem is not None:
        return problem
    first, last = int(upper[0]), int(upper[-1])
    foot = low + _FOOT * (high - low)
    first -= int(s[first - 1] > foot)
    last += int(s[last + 1] > foot)
    if last - first + 1 < _LEAST:
        return Failure(
            "coarse", f"{last - first + 1} stops on the peak, at least {_LEAST}"
        )
    return Hill(z=z, s=s, low=low, high=high, first=first, last=last)


def _shape(upper: np.ndarray[tuple[int], np.dtype[np.intp]], n: int) -> Failure | None:
    """Return why the stops of the upper half are not one peak inside the sweep."""
    if upper[0] == 0 or upper[-1] == n - 1:
        return Failure("border", "the peak reaches the end of the sweep")
    if upper[-1] - upper[0] + 1 != len(upper):
        return Failure("several_peaks", "the upper half has gaps")
    return None
