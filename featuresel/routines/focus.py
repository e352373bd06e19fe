"""Height by focus: a sharpness score of one image, and the peak over a sweep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from featuresel.routines import Failure, FloatArray
from featuresel.routines.sampling import BoolArray

_FEWEST = 5  # stops in a sweep
_LEAST = 4  # of them on the peak: one more than the curve has numbers
_FOOT = 0.1  # of the height: neighbours of the upper half join in above this
_FLAT = 0.15  # of the highest score, the least the scores must vary by
_ROUNDS = 6  # of reweighting the logarithm's noise


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusPeak:
    """Where a sweep was sharpest."""

    z_um: float
    sigma_um: float  # standard deviation, from how well the curve fits
    width_um: float  # standard deviation of the fitted Gaussian


def ring_mask(
    shape: tuple[int, int],
    column: float,
    row: float,
    radius_px: float,
    half_px: float,
) -> BoolArray:
    """Return the pixels within `half_px` of a circle, (rows, columns) bool."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    distance = np.hypot(columns - column, rows - row)
    return np.asarray(np.abs(distance - radius_px) <= half_px)


def score(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the Tenengrad sharpness of an image.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale.
    mask : (rows, columns) bool array, optional
        Pixels that count; default all.

    Returns
    -------
    float
        Mean squared Sobel gradient over the squared mean brightness, so that the
        light's level does not matter; >= 0.

    Raises
    ------
    ValueError
        If no pixel counts or the image is black there.

    References
    ----------
    Tenenbaum (1970); compared by Sun, Duthaler & Nelson (2004).
    """
    picked = np.ones(image.shape, dtype=bool) if mask is None else mask
    if not picked.any():
        raise ValueError("the mask must leave at least one pixel")
    brightness = float(image[picked].mean())
    if not brightness > 0:
        raise ValueError("the image is black where it is scored")
    across = cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3)
    down = cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3)
    energy = float((across[picked] ** 2 + down[picked] ** 2).mean())
    return energy / 64 / brightness**2  # Sobel's weights add up to 8 a pixel


def peak(
    z_um: Sequence[float] | FloatArray, scores: Sequence[float] | FloatArray
) -> FocusPeak | Failure:
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
    used = np.arange(upper[0] - 1, upper[-1] + 2)
    used = used[s[used] > low + _FOOT * (high - low)]
    if len(used) < _LEAST:
        return Failure(
            code="coarse",
            message=f"{len(used)} stops on the peak, at least {_LEAST}",
        )
    return _gaussian(z[used], s[used] - low)


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
