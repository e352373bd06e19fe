"""Focus measures and the fits that the default ones are compared with.

Each measure takes an image, (rows, columns) float 0..1 of full scale, and a mask of the
pixels that count, (rows, columns) bool, default all. Each returns a number >= 0
(Vollath's may fall below it in noise) and raises ValueError if no pixel counts or the
image is black where it is scored. A measure of light squared is divided by the mean
brightness squared, one of light by the mean, so that the light's level cancels;
differences are taken along rows and columns alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.focus.measures import (
    Measure,
    picked_pixels,
    sobel,
    tenengrad,
)
from microplan.featuresel.routines.focus.peak import (
    FocusPeak,
    Numbers,
    find_hill,
    mirror_peak,
)

Fit = Callable[[Numbers, Numbers], FocusPeak | Failure]

MEASURE = "tenengrad"  # the default
_BLOCK = 8  # pixels a side of a cosine transform
_LOWEST = ((0, 1), (0, 2), (1, 0), (2, 0), (1, 1))  # frequencies counted in a block
_ROUNDS = 6  # of reweighting the logarithm's noise


def gradient_sum(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of sqrt(gx^2 + gy^2) over the mean brightness.

    References
    ----------
    Feddema & Simon (1998) focus by the sum of the gradient's magnitude.
    """
    picked, brightness = picked_pixels(image, mask)
    across, down = sobel(image)
    return float(np.hypot(across, down)[picked].mean()) / brightness


def brenner(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of (g(x + 2) - g(x))^2, both axes, over brightness squared.

    References
    ----------
    Brenner et al. (1976), J. Histochem. Cytochem. 24, 100-111; there along rows only.
    """
    picked, brightness = picked_pixels(image, mask)
    energy = 0.0
    for g, counts in _both_ways(image, picked):
        energy += _mean((g[:, 2:] - g[:, :-2]) ** 2, counts[:, :-2])
    return energy / brightness**2


def vollath_f4(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of g(x) g(x + 1) - g(x) g(x + 2), both axes, over brightness^2.

    Noise of single pixels has no part in its mean: no pixel meets itself.

    References
    ----------
    Vollath (1987), J. Microscopy 147, 279-288, F4; there along rows only.
    """
    picked, brightness = picked_pixels(image, mask)
    energy = 0.0
    for g, counts in _both_ways(image, picked):
        product = g[:, :-2] * (g[:, 1:-1] - g[:, 2:])
        energy += _mean(product, counts[:, :-2])
    return energy / brightness**2


def laplacian_energy(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of (gxx + gyy)^2 over the mean brightness squared.

    References
    ----------
    Subbarao, Choi & Nikzad (1993), Optical Engineering 32, 2824-2836.
    """
    picked, brightness = picked_pixels(image, mask)
    curved = cv2.Laplacian(image, cv2.CV_64F, ksize=1)
    return float((curved[picked] ** 2).mean()) / brightness**2


def normalised_variance(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the variance over the mean brightness squared.

    References
    ----------
    Groen, Young & Ligthart (1985), Cytometry 6, 81-91; F11 of Sun, Duthaler & Nelson
    (2004) divides by the mean once, which leaves the light's level in.
    """
    picked, brightness = picked_pixels(image, mask)
    return float(image[picked].var()) / brightness**2


def dct_ratio(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the energy of five low frequencies over that of the mean, block by block.

    Blocks are 8 x 8 pixels side by side; a block weighs as many pixels as count in it,
    and a black one nothing.

    References
    ----------
    Lee, Yoo, Kumar & Kim (2009), IEEE Signal Processing Letters 16, 133-136.
    """
    picked, _ = picked_pixels(image, mask)
    rows, columns = (side // _BLOCK for side in image.shape)
    shape = (rows, _BLOCK, columns, _BLOCK)
    inside = np.s_[: rows * _BLOCK, : columns * _BLOCK]
    blocks = image[inside].reshape(shape)
    weight = picked[inside].reshape(shape).sum(axis=(1, 3)).astype(np.float64)
    basis = _cosines()
    level = np.einsum("aibj->ab", blocks) / _BLOCK
    energy = np.zeros((rows, columns))
    for down, across in _LOWEST:
        energy += np.einsum("aibj,i,j->ab", blocks, basis[down], basis[across]) ** 2
    weight[level <= 0] = 0.0
    if not weight.any():
        raise ValueError(f"no block of {_BLOCK} x {_BLOCK} pixels counts")
    ratio = energy / np.where(level > 0, level, 1.0) ** 2
    return float((ratio * weight).sum() / weight.sum())


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


MEASURES: Mapping[str, Measure] = {
    "tenengrad": tenengrad,
    "brenner": brenner,
    "vollath_f4": vollath_f4,
    "gradient_sum": gradient_sum,
    "laplacian_energy": laplacian_energy,
    "dct_ratio": dct_ratio,
    "normalised_variance": normalised_variance,
}
FITS: Mapping[str, Fit] = {"gaussian": gaussian_peak, "mirror": mirror_peak}


def _both_ways(
    image: FloatArray, picked: BoolArray
) -> tuple[tuple[FloatArray, BoolArray], tuple[FloatArray, BoolArray]]:
    """Return image and mask as they are, and with rows for columns."""
    return (image, picked), (image.T, picked.T)


def _mean(values: FloatArray, counts: BoolArray) -> float:
    """Return the mean of what counts, 0 where nothing does."""
    return float(values[counts].mean()) if counts.any() else 0.0


def _cosines() -> FloatArray:
    """Return the orthonormal cosines of a block, (frequency, pixel)."""
    k, n = np.ogrid[:_BLOCK, :_BLOCK]
    basis = math.sqrt(2 / _BLOCK) * np.cos(math.pi * (2 * n + 1) * k / (2 * _BLOCK))
    basis[0] /= math.sqrt(2)
    return np.asarray(basis)


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
