"""Tiles of whole camera pixels: where they lie, and sampling spectra at pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from optics.clip import Box
from optics.microscope import Microscope
from optics.outline import Outline
from optics.scene import Window
from optics.spectrum import Tile

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """One axis of a tile, in pixels of the frame."""

    start: int  # the pixel of the first sample
    count: int  # samples in a period
    seen: range  # pixels of the window that may be read
    cut: tuple[float, float] | None  # where the outline is cut; None for the period


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelTile:
    """A tile whose samples are camera pixels."""

    columns: Span
    rows: Span  # down the frame


def choose_tile(
    outline: Outline,
    microscope: Microscope,
    margin_um: float,
    frame: Window,
    shift_um: tuple[float, float],
) -> PixelTile | None:
    """Return the tile on which an outline's image can be computed.

    Parameters
    ----------
    outline : Outline
        The body, um; its image is displaced by `shift_um`.
    microscope : Microscope
        The optical setting.
    margin_um : float
        How far light spreads.
    frame : Window
        The pixels wanted.
    shift_um : (x, y)
        Displacement of the image.

    Returns
    -------
    PixelTile or None
        Every pixel seen is at least the margin away from where the outline is cut, and
        from its repetitions. None where no pixel is within the margin.
    """
    if not outline.rings:
        return None
    k = microscope.px_per_um
    cx, cy = axis_px(microscope)
    x_min, y_min, x_max, y_max = outline.bounds_um
    columns = _span(
        (cx + k * (x_min + shift_um[0]), cx + k * (x_max + shift_um[0])),
        (frame.column, frame.column + frame.columns - 1),
        margin_um * k,
    )
    rows = _span(
        (cy - k * (y_max + shift_um[1]), cy - k * (y_min + shift_um[1])),
        (frame.row, frame.row + frame.rows - 1),
        margin_um * k,
    )
    if columns is None or rows is None:
        return None
    return PixelTile(columns=columns, rows=rows)


def _span(
    body: tuple[float, float], wanted: tuple[int, int], margin: float
) -> Span | None:
    """Choose one axis of a tile; all in pixels."""
    low, high = body
    first = max(wanted[0], math.floor(low - margin))
    last = min(wanted[1], math.ceil(high + margin))
    if last < first:
        return None
    seen = range(first, last + 1)
    left, right = max(low, first - margin), min(high, last + margin)
    start = math.floor(min(left, first))
    if left > low and right < high:  # the body fills the period and runs on
        return Span(start=start, count=_fast(right - start), seen=seen, cut=None)
    apart = max(right - first, last - left) + margin  # from the repetitions
    count = _fast(max(apart, max(right, last) - start + 2))
    whole = left == low and right == high
    cut = None if whole else (left, right)
    return Span(start=start, count=count, seen=seen, cut=cut)


def to_world(
    tile: PixelTile, microscope: Microscope, shift_um: tuple[float, float]
) -> tuple[Tile, Box]:
    """Return the tile, and the box that cuts the outline, before the shift, um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    x, y = tile.columns, tile.rows
    world = Tile(
        left_um=(x.start - cx) * p - shift_um[0],
        bottom_um=(cy - (y.start + y.count - 1)) * p - shift_um[1],
        width_um=x.count * p,
        height_um=y.count * p,
    )
    x_min, y_min, x_max, y_max = world.box
    if x.cut is not None:
        x_min, x_max = ((edge - cx) * p - shift_um[0] for edge in x.cut)
    if y.cut is not None:
        y_max, y_min = ((cy - edge) * p - shift_um[1] for edge in y.cut)
    return world, (x_min, y_min, x_max, y_max)


def sample(values: ComplexArray, tile: PixelTile) -> FloatArray:
    """Return the image at the pixels seen, (rows, columns), from its coefficients."""
    x, y = tile.columns, tile.rows
    bottom = y.start + y.count - 1
    if _by_product_is_cheaper(values.shape, tile):
        up = (bottom - np.asarray(y.seen)) / y.count
        right = (np.asarray(x.seen) - x.start) / x.count
        return _sample_by_product(values, up, right)
    image = _sample_by_fft(values, y.count, x.count)[::-1]
    r0, c0 = y.seen.start - y.start, x.seen.start - x.start
    return image[r0 : r0 + len(y.seen), c0 : c0 + len(x.seen)]


def axis_px(microscope: Microscope) -> tuple[float, float]:
    """Return (column, row) of the optical axis."""
    return ((microscope.width_px - 1) / 2, (microscope.height_px - 1) / 2)


def _fast(least: float) -> int:
    """Return the next length that transforms fast."""
    size = fft.next_fast_len(math.ceil(least), real=True)
    if size is None:  # only if the length overflowed
        raise ValueError(f"no transform of length {least}")
    return size


def _by_product_is_cheaper(shape: tuple[int, ...], tile: PixelTile) -> bool:
    """Compare operation counts of the two ways to sample."""
    rows, columns = len(tile.rows.seen), len(tile.columns.seen)
    product = rows * shape[1] * (shape[0] + columns / 2)
    pixels = tile.rows.count * tile.columns.count
    # a transform's operations take about three times as long as a product's
    return product < 3 * pixels * math.log2(max(pixels, 2))


def _sample_by_product(
    values: ComplexArray, y: FloatArray, x: FloatArray
) -> FloatArray:
    """Sum the waves at heights y (R,) and places x (C,), both in tiles."""
    K, J = values.shape[0] // 2, values.shape[1] - 1
    wave_y = np.exp(2j * np.pi * y[:, None] * np.r_[0 : K + 1, -K:0])
    wave_x = np.exp(2j * np.pi * np.arange(J + 1)[:, None] * x)
    wave_x[1:] *= 2  # the other half of the spectrum is the conjugate
    lines = wave_y @ values
    image: FloatArray = lines.real @ wave_x.real - lines.imag @ wave_x.imag
    return image


def _sample_by_fft(values: ComplexArray, rows: int, columns: int) -> FloatArray:
    """Fold the spectrum to the pixels' frequencies and transform; y up."""
    K, J = values.shape[0] // 2, values.shape[1] - 1
    folded = np.zeros((rows, J + 1), dtype=np.complex128)
    for start, first in ((0, 0), (-K, K + 1)):
        count = K + 1 if first == 0 else K
        for to, part in _laps(start, count, rows):
            source = slice(first + part.start, first + part.stop)
            folded[to : to + part.stop - part.start] += values[source]
    lines = fft.ifft(folded, axis=0, overwrite_x=True)
    half = np.zeros((rows, columns // 2 + 1), dtype=np.complex128)
    half[:, 0] = lines[:, 0]
    for j in _mirrored(half, lines, columns):  # orders that fold onto 0 or Nyquist
        half[:, min(j % columns, columns - j % columns)] += 2 * lines[:, j].real
    image: FloatArray = fft.irfft(half, n=columns, axis=1) * (rows * columns)
    return image


def _mirrored(half: ComplexArray, lines: ComplexArray, columns: int) -> list[int]:
    """Add the columns of `lines` to `half`; return those that are their own mirror."""
    J = lines.shape[1] - 1
    own: list[int] = []
    for to, part in _laps(1, J, columns):
        begin = part.start + 1  # order of the lap's first column
        orders = np.arange(begin, part.stop + 1)
        place = to + np.arange(orders.size)
        up = (place > 0) & (2 * place < columns)
        down = 2 * place > columns
        half[:, place[up]] += lines[:, orders[up]]
        half[:, columns - place[down]] += np.conj(lines[:, orders[down]])
        own.extend(int(j) for j in orders[~up & ~down])
    return own


def _laps(start: int, count: int, period: int) -> Iterator[tuple[int, slice]]:
    """Cut orders start..start + count - 1 where they wrap; yield place and slice."""
    done = 0
    while done < count:
        place = (start + done) % period
        step = min(period - place, count - done)
        yield place, slice(done, done + step)
        done += step
