"""Peaks of a focus sweep: what counts as one, and the Gaussian through it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure

Numbers = Sequence[float] | FloatArray

_FEWEST = 5  # stops in a sweep
_LEAST = 4  # of them on the peak: one more than a curve has numbers
_FOOT = 0.1  # of the height: neighbours of the upper half join in above this
_FLAT = 0.15  # of the highest score, the least the scores must vary by
_ROUNDS = 6  # of reweighting the logarithm's noise


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


def gaussian_peak(z_um: Numbers, scores: Numbers) -> FocusPeak | Failure:
    """Return where the scores peak, by a Gaussian through their upper half.

    One stop more on either side joins in, lightly weighted, so that coarse sweeps have
    enough of them.

    Parameters
    ----------
    z_um : (N,) sequence of float
        Stops of the sweep, strictly rising, N >= 5.
    scores : (N,) sequence of float
        Sharpness at each.

    Returns
    -------
    FocusPeak or Failure
        Fails with "few_stops", "flat", "border" (the peak is not inside the sweep),
        "several_peaks" or "coarse" (fewer than 4 stops on the peak).

    Raises
    ------
    ValueError
        If the lengths differ, the stops do not rise or a value is not finite.
    """
    hill = find_hill(z_um, scores)
    if isinstance(hill, Failure):
        return hill
    used = slice(hill.first, hill.last + 1)
    return _gaussian(hill.z[used], hill.s[used] - hill.low)


def find_hill(z_um: Numbers, scores: Numbers) -> Hill | Failure:
    """Return the sweep if it has one peak inside, with enough stops on it."""
    z, s = np.array(z_um, dtype=np.float64), np.array(scores, dtype=np.float64)
    if z.shape != s.shape or z.ndim != 1:
        raise ValueError(f"need as many stops as scores, got {len(z)} and {len(s)}")
    if not (np.isfinite(z).all() and np.isfinite(s).all() and (np.diff(z) > 0).all()):
        raise ValueError("stops must rise and all values be finite")
    if len(z) < _FEWEST:
        return Failure(code="few_stops", message=f"{len(z)} stops, at least {_FEWEST}")
    low, high = float(s.min()), float(s.max())
    if high - low <= _FLAT * abs(high):
        return Failure(
            code="flat",
            message=f"scores vary from {low:.4g} to {high:.4g}, "
            f"by {_FLAT:.0%} at least",
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
            code="coarse",
            message=f"{last - first + 1} stops on the peak, at least {_LEAST}",
        )
    return Hill(z=z, s=s, low=low, high=high, first=first, last=last)


def _shape(upper: np.ndarray[tuple[int], np.dtype[np.intp]], n: int) -> Failure | None:
    """Return why the stops of the upper half are not one peak inside the sweep."""
    if upper[0] == 0 or upper[-1] == n - 1:
        return Failure(code="border", message="the peak reaches the end of the sweep")
    if upper[-1] - upper[0] + 1 != len(upper):
        return Failure(code="several_peaks", message="the upper half has gaps")
    return None


def _gaussian(z: FloatArray, height: FloatArray) -> FocusPeak | Failure:
    """Return the Gaussian through positive heights, weighted by the fit itself.

    References
    ----------
    Guo (2011): the logarithm of noisy values needs weights of the model squared.
    """
    middle, scale = float(z.mean()), float(np.ptp(z))
    x = (z - middle) / scale
    design = np.stack((np.ones_like(x), x, x * x), axis=1)
    target, weight = np.log(height), height
    for _ in range(_ROUNDS):
        a, b, c = np.linalg.lstsq(design * weight[:, None], target * weight)[0]
        weight = np.exp(np.clip(a + b * x + c * x * x, -50, 50))
    if not c < 0:
        return Failure(code="flat", message="the upper half has no maximum")
    top = -b / (2 * c)
    if not x[0] <= top <= x[-1]:
        return Failure(code="border", message="the fitted peak is off the upper half")
    left = (target - design @ np.array((a, b, c))) * weight
    variance = float(left @ left) / max(len(z) - 3, 1)
    normal = (design * weight[:, None]).T @ (design * weight[:, None])
    gradient = np.array((0.0, -1 / (2 * c), b / (2 * c * c)))
    spread = math.sqrt(variance * float(gradient @ np.linalg.solve(normal, gradient)))
    return FocusPeak(
        z_um=middle + scale * float(top),
        sigma_um=scale * spread,
        width_um=scale * math.sqrt(-1 / (2 * float(c))),
    )
