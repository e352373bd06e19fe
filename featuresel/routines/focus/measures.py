"""Focus measures: how sharp one image is, whatever the light's level.

Each takes an image, (rows, columns) float 0..1 of full scale, and a mask of the pixels
that count, (rows, columns) bool, default all. Each returns a number >= 0 (Vollath's may
fall below it in noise) and raises ValueError if no pixel counts or the image is black
where it is scored. A measure of light squared is divided by the mean brightness
squared, one of light by the mean, so that the light's level cancels; differences
are taken along rows and columns alike, so that edges of any direction count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray

Measure = Callable[[FloatArray, BoolArray | None], float]

_SOBEL = 8.0  # its weights add up to this per pixel of distance
_BLOCK = 8  # pixels a side of a cosine transform
_LOWEST = ((0, 1), (0, 2), (1, 0), (2, 0), (1, 1))  # frequencies counted in a block


def tenengrad(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of gx^2 + gy^2 over the mean brightness squared.

    gx and gy are Sobel's gradients per pixel.

    References
    ----------
    Tenenbaum (1970); Krotkov (1987), Int. J. Computer Vision 1, 223-237.
    """
    picked, brightness = _picked(image, mask)
    across, down = _sobel(image)
    return float((across**2 + down**2)[picked].mean()) / brightness**2


def gradient_sum(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of sqrt(gx^2 + gy^2) over the mean brightness.

    References
    ----------
    Feddema & Simon (1998) focus by the sum of the gradient's magnitude.
    """
    picked, brightness = _picked(image, mask)
    across, down = _sobel(image)
    return float(np.hypot(across, down)[picked].mean()) / brightness


def brenner(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of (g(x + 2) - g(x))^2, both axes, over brightness squared.

    References
    ----------
    Brenner et al. (1976), J. Histochem. Cytochem. 24, 100-111; there along rows only.
    """
    picked, brightness = _picked(image, mask)
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
    picked, brightness = _picked(image, mask)
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
    picked, brightness = _picked(image, mask)
    curved = cv2.Laplacian(image, cv2.CV_64F, ksize=1)
    return float((curved[picked] ** 2).mean()) / brightness**2


def normalised_variance(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the variance over the mean brightness squared.

    References
    ----------
    Groen, Young & Ligthart (1985), Cytometry 6, 81-91; F11 of Sun, Duthaler & Nelson
    (2004) divides by the mean once, which leaves the light's level in.
    """
    picked, brightness = _picked(image, mask)
    return float(image[picked].var()) / brightness**2


def dct_ratio(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the energy of five low frequencies over that of the mean, block by block.

    Blocks are 8 x 8 pixels side by side; a block weighs as many pixels as count in it,
    and a black one nothing.

    References
    ----------
    Lee, Yoo, Kumar & Kim (2009), IEEE Signal Processing Letters 16, 133-136.
    """
    picked, _ = _picked(image, mask)
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


MEASURES: Mapping[str, Measure] = {
    "tenengrad": tenengrad,
    "brenner": brenner,
    "vollath_f4": vollath_f4,
    "gradient_sum": gradient_sum,
    "laplacian_energy": laplacian_energy,
    "dct_ratio": dct_ratio,
    "normalised_variance": normalised_variance,
}


def _picked(image: FloatArray, mask: BoolArray | None) -> tuple[BoolArray, float]:
    """Return the pixels that count and their mean brightness."""
    picked = np.ones(image.shape, dtype=bool) if mask is None else mask
    if not picked.any():
        raise ValueError("the mask must leave at least one pixel")
    brightness = float(image[picked].mean())
    if not brightness > 0:
        raise ValueError("the image is black where it is scored")
    return picked, brightness


def _sobel(image: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradients along columns and rows per pixel."""
    across = cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, scale=1 / _SOBEL)
    down = cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3, scale=1 / _SOBEL)
    return across.astype(np.float64), down.astype(np.float64)


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
