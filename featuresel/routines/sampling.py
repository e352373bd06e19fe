"""Image values between pixels, and the edges along lines of them.

OpenCV's `remap` rounds coordinates to 1/32 px, which is more than the noise of a
caliper; these functions do not round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray

STEP_PX = 0.5  # of the samples along a line: half a pixel, finer adds no information
# Widths tried for the edge filter: in focus to a blur of about 30 px across.
WIDTHS_PX = (0.8, 1.2, 1.8, 2.7, 4.0, 6.0)


def cubic(
    image: FloatArray, columns: FloatArray, rows: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return image values at any points by cubic convolution.

    Parameters
    ----------
    image : (rows, columns) float array
        At least 4 x 4 pixels.
    columns, rows : (...) float arrays
        Points, px; pixel centres are integers.

    Returns
    -------
    values : (...) float64 array
        Values; a point outside takes that of the nearest border.
    inside : (...) bool array
        Whether the point lies between pixel centres of the image.

    References
    ----------
    Keys (1981), with a = -1/2: exact for quadratics.
    """
    height, width = image.shape
    x = np.minimum(np.maximum(columns, 0), width - 1)
    y = np.minimum(np.maximum(rows, 0), height - 1)
    left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    across, down = _keys(x - left), _keys(y - top)
    # one flat index for each point is read twice as fast as a pair
    near = [np.minimum(np.maximum(left + i, 0), width - 1) for i in (-1, 0, 1, 2)]
    pixels = image.ravel()
    values = np.zeros(np.shape(x))
    for j in range(4):
        line = np.minimum(np.maximum(top + (j - 1), 0), height - 1) * width
        row_sum = np.zeros_like(values)
        for i in range(4):
            row_sum += across[i] * pixels.take(line + near[i])
        values += down[j] * row_sum
    return values, (x == columns) & (y == rows)


def median(values: FloatArray) -> float:
    """Return the median of (N,) samples, N >= 1; a third of `np.median`'s time."""
    ordered, half = np.sort(values), len(values) // 2
    if len(values) % 2:
        return float(ordered[half])
    return float((ordered[half - 1] + ordered[half]) / 2)


def _keys(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the weights of the 4 neighbours for `t` in 0..1 past the 2nd."""
    return (
        ((2 - t) * t - 1) * t / 2,
        ((3 * t - 5) * t * t + 2) / 2,
        ((4 - 3 * t) * t + 1) * t / 2,
        (t - 1) * t * t / 2,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LineEdges:
    """The strongest edge on each of N lines; `offset_px` is 0 where `found` is not."""

    offset_px: FloatArray  # (N,) from the middle of the line
    strength: FloatArray  # (N,) height of the step, image units; 0 if the line is short
    found: BoolArray  # (N,) a peak inside the line


def find_edges(
    image: FloatArray,
    columns: FloatArray,
    rows: FloatArray,
    *,
    width_px: float,
    rising: bool,
) -> LineEdges:
    """Return the strongest rising or falling edge along each line.

    Parameters
    ----------
    image : (rows, columns) float array
        The image.
    columns, rows : (N, L) float arrays
        Samples of N lines, `STEP_PX` apart, L odd, the expected edge in the middle.
    width_px : float
        Standard deviation of the smoothing, px.
    rising : bool
        Whether the image gets brighter along the line.

    Returns
    -------
    LineEdges
        By the peak of the first Gaussian derivative and a parabola through it.
    """
    profiles, inside = cubic(image, columns, rows)
    kernel = edge_kernel(width_px)
    reach = len(kernel) // 2
    count = profiles.shape[1] - 2 * reach
    if count < 3:
        raise ValueError(f"lines of {profiles.shape[1]} samples are too short")
    windows = np.lib.stride_tricks.sliding_window_view(profiles, len(kernel), axis=1)
    response = windows @ (kernel if rising else -kernel)
    if not inside.all():
        whole = np.lib.stride_tricks.sliding_window_view(inside, len(kernel), axis=1)
        response[~whole.all(axis=2)] = -np.inf
    return _peaks(response)


def _peaks(response: FloatArray) -> LineEdges:
    """Return the highest inner sample of each row with a parabola through it."""
    lines, count = response.shape
    each = np.arange(lines)
    at = response.argmax(axis=1)
    near = np.clip(at, 1, count - 2)
    before, peak, after = (response[each, near + k] for k in (-1, 0, 1))
    found = (at == near) & np.isfinite(before) & np.isfinite(after)
    safe = [np.where(found, v, w) for v, w in ((before, 0), (peak, 1), (after, 0))]
    shift = (safe[2] - safe[0]) / (2 * (2 * safe[1] - safe[0] - safe[2]) + 1e-300)
    offset = (near - (count - 1) / 2 + np.clip(shift, -0.5, 0.5)) * STEP_PX
    return LineEdges(
        offset_px=np.where(found, offset, 0.0),
        strength=np.where(found, safe[1], 0.0),
        found=found,
    )


def edge_kernel(width_px: float) -> FloatArray:
    """Return the derivative of a Gaussian, (2 K + 1,); a unit step gives 1."""
    reach = math.ceil(3 * width_px / STEP_PX)
    x = np.arange(-reach, reach + 1, dtype=np.float64) * STEP_PX
    kernel: FloatArray = x * np.exp(-((x / width_px) ** 2) / 2)
    kernel /= kernel[reach + 1 :].sum()
    return kernel


def best_width(profile: FloatArray) -> float:
    """Return the filter width that locates the edge in the middle of `profile` best.

    Parameters
    ----------
    profile : (L,) float array
        The noise-free edge, samples `STEP_PX` apart, L odd.

    Returns
    -------
    float
        The one of `WIDTHS_PX` with the largest curvature of the response over the
        noise of its slope, px.

    References
    ----------
    Canny (1986), the localisation criterion.
    """
    quality = [_localisation(profile, width) for width in WIDTHS_PX]
    return WIDTHS_PX[int(np.argmax(quality))]


def _localisation(profile: FloatArray, width_px: float) -> float:
    """Return curvature over slope noise, 0 where the filter does not fit."""
    kernel = edge_kernel(width_px)
    if len(kernel) + 2 > len(profile):
        return 0.0
    response = np.convolve(profile, kernel[::-1], mode="valid")
    k = len(response) // 2
    curvature = abs(response[k - 1] - 2 * response[k] + response[k + 1])
    return float(curvature / np.linalg.norm(np.diff(kernel)))


def line_samples(half_px: float, width_px: float) -> FloatArray:
    """Return offsets (L,) of a line that searches `half_px` to both sides, px."""
    reach = math.ceil(half_px / STEP_PX) + len(edge_kernel(width_px)) // 2 + 1
    return np.arange(-reach, reach + 1, dtype=np.float64) * STEP_PX
