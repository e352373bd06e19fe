"""Second moments of residuals by which edges, faces and pixels are told apart."""

from __future__ import annotations

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.planner.calibration.discrepancy.picture_misfit import PictureMisfit

Step = tuple[int, int]  # px down and right

NAMES = ("edge", "flat", "pixel")
ROUGH = np.outer((1.0, -2.0, 1.0), (1.0, -2.0, 1.0)) / 6  # squares sum to 1
NEXT = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows, columns: neighbours along edges
FAR = ((0, 3), (3, 0))  # on faces: noise that neighbours share is gone there


def moments(one: PictureMisfit, other: PictureMisfit | None = None) -> FloatArray:
    """Return moments of a residual, (3,), near the squares of edge, flat and pixel.

    White noise adds nothing to the first two, whose products are of different pixels;
    its variance is taken off the third, or products of two frames have none.

    Parameters
    ----------
    one : PictureMisfit
        Of a picture.
    other : PictureMisfit, optional
        Of another frame of the same pixels.
    """
    edge = _shared(one.residual, one.steps, one.edges, NEXT)
    flat = _shared(one.residual, one.image, one.faces, FAR)
    return np.array([edge, flat, _pixel(one, other)])


def _shared(
    residual: FloatArray,
    weight: FloatArray,
    where: BoolArray,
    steps: tuple[Step, ...],
) -> float:
    """Return the mean product of residuals a step apart, as shares of a weight."""
    top = below = 0.0
    product, square = residual * weight * where, weight**2 * where
    for step in steps:
        top += _product(product, step)
        below += _product(square, step)
    return top / below if below > 0 else 0.0


def _product(values: FloatArray, step: Step) -> float:
    """Return the sum of products of values (R, C) with those a step away."""
    here, there = a_step_apart(values, step)
    return float(np.sum(here * there))


def a_step_apart(values: FloatArray, step: Step) -> tuple[FloatArray, FloatArray]:
    """Return values (..., R, C) that have others a step away, and those."""
    (down, right), (rows, columns) = step, values.shape[-2:]
    low, left = max(-down, 0), max(-right, 0)
    high, wide = rows - max(down, 0), columns - max(right, 0)
    there = slice(low + down, high + down), slice(left + right, wide + right)
    return values[..., low:high, left:wide], values[..., there[0], there[1]]


def inner_pixels(used: BoolArray) -> BoolArray:
    """Return pixels (R, C) whose eight neighbours are used, too."""
    near = np.ones((3, 3), np.uint8)
    inner: BoolArray = cv2.erode(used.astype(np.uint8), near, borderValue=0) > 0
    return inner


def _pixel(one: PictureMisfit, other: PictureMisfit | None) -> float:
    """Return the variance at the finest detail, over the step's square."""
    inner = inner_pixels(one.used)
    rough = cv2.filter2D(one.residual, -1, ROUGH)[inner]
    if other is None:
        own = cv2.filter2D(one.noise, -1, ROUGH**2)[inner]
        return float(np.mean(rough**2 - own)) / one.step**2
    again = cv2.filter2D(other.residual, -1, ROUGH)[inner]
    return float(np.mean(rough * again)) / (one.step * other.step)
