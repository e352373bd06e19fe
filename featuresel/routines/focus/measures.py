"""Focus measure: the sharpness of one image, whatever the light's level.

`benchmarks/focus` compares it with others.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray

Measure = Callable[[FloatArray, BoolArray | None], float]

# Half width of the scored ring over its radius: wide enough for the edge's blur some
# tens of um out of focus, too narrow for the post inside a bore or the teeth outside.
RING_HALF = 0.2
_SOBEL = 8.0  # its weights add up to this per pixel of distance


def tenengrad(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the mean of gx^2 + gy^2 over the mean brightness squared, dimensionless.

    gx and gy are Sobel's gradients per pixel, along rows and columns alike, so that
    edges of any direction count.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale.
    mask : (rows, columns) bool array, optional
        Pixels that count; default all.

    Raises
    ------
    ValueError
        If no pixel counts or the image is black there.

    References
    ----------
    Tenenbaum (1970); Krotkov (1987), Int. J. Computer Vision 1, 223-237.
    """
    picked, brightness = picked_pixels(image, mask)
    across, down = sobel(image)
    return float((across**2 + down**2)[picked].mean()) / brightness**2


def face_sharpness(
    image: FloatArray, column: float, row: float, radius_px: float
) -> float:
    """Return how sharp a face's edges are, as a run scores a stop of its sweep.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale.
    column, row : float
        Middle of the face, pixels of the image.
    radius_px : float
        Edges about this radius count; 0: all.

    Raises
    ------
    ValueError
        If the ring is out of the image or the image is black there.
    """
    mask = None
    if radius_px:
        mask = ring_mask(
            (image.shape[0], image.shape[1]),
            column,
            row,
            radius_px,
            RING_HALF * radius_px,
        )
    return tenengrad(image, mask)


def ring_mask(
    shape: tuple[int, int],
    column: float,
    row: float,
    radius_px: float,
    half_px: float,
) -> BoolArray:
    """Return the pixels within `half_px` of a circle, (rows, columns) bool; px."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    distance = np.hypot(columns - column, rows - row)
    return np.asarray(np.abs(distance - radius_px) <= half_px)


def picked_pixels(image: FloatArray, mask: BoolArray | None) -> tuple[BoolArray, float]:
    """Return the pixels that count, (rows, columns), and their mean light, 0..1."""
    picked = np.ones(image.shape, dtype=bool) if mask is None else mask
    if not picked.any():
        raise ValueError("the mask must leave at least one pixel")
    brightness = float(image[picked].mean())
    if not brightness > 0:
        raise ValueError("the image is black where it is scored")
    return picked, brightness


def sobel(image: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradients along columns and rows, (rows, columns), per px."""
    across = cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, scale=1 / _SOBEL)
    down = cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3, scale=1 / _SOBEL)
    return across.astype(np.float64), down.astype(np.float64)
