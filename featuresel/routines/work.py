"""What pieces of image work cost, in 640 x 480 box filters of 64-bit pixels.

Numbers of values times what one takes, plus what calling numpy takes however few there
are. The constants were read off one machine once and are only that;
`benchmarks/localisation/costs` prints how far the models that use them are from CPU
time.
"""

from __future__ import annotations

CALLS = 0.25  # some twenty calls of numpy, as interpolation makes
_VALUE = 1.5e-4  # one value by cubic convolution
_PRODUCT = 1.6e-6  # one product and sum of a filter along lines
_PEAK = 2e-3  # of one line: the highest response and the parabola through it
_CORRELATED = 3e-5  # one pixel of the searched part, by Fourier transforms
_EQUATION = 3e-5  # one row of a least-squares problem, per unknown
_SMOOTHED = 5e-6  # one pixel of a Gaussian, per pixel of its width


def read(values: float) -> float:
    """Return the work of interpolating `values` values."""
    return CALLS + _VALUE * values


def edges(lines: float, length: float, kernel: float) -> float:
    """Return the work of finding the edge on `lines` lines of `length` samples."""
    filtered = max(length - kernel + 1, 0) * kernel
    return CALLS / 2 + read(lines * length) + lines * (_PRODUCT * filtered + _PEAK)


def least_squares(rows: float, unknowns: float) -> float:
    """Return the work of a least-squares problem."""
    return CALLS / 6 + _EQUATION * rows * unknowns


def circle(points: float) -> float:
    """Return the work of a trimmed circle through `points` points."""
    return 8 * CALLS + 15 * least_squares(points, 3) / 3


def centre() -> float:
    """Return the work of the centre of a circle of known radius."""
    return 4 * CALLS


def correlate(pixels: float) -> float:
    """Return the work of correlating a template with a part of `pixels` pixels."""
    return CALLS / 8 + _CORRELATED * pixels


def smooth(pixels: float, sigma_px: float) -> float:
    """Return the work of a Gaussian filter."""
    return CALLS / 8 + _SMOOTHED * pixels * (1 + 6 * sigma_px)
