"""Tiles of whole camera pixels: where they lie, and sampling spectra at pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from optics.microscope import Microscope
from optics.outline import Outline
from optics.scene import Window
from optics.spectrum import Tile

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelTile:
    """A tile whose samples are camera pixels; its first column is X = 0."""

    row: int  # of the top sample
    column: int
    rows: int
    columns: int

    def overlap(self, frame: Window) -> tuple[range, range]:
        """Return the frame's rows and columns that lie in the tile."""
        return (
            _common(self.row, self.rows, frame.row, frame.rows),
            _common(self.column, self.columns, frame.column, frame.columns),
        )


def choose_tile(
    outline: Outline,
    microscope: Microscope,
    margin_um: float,
    frame: Window,
    shift_um: tuple[float, float],
) -> PixelTile | None:
    """Return the pixels where an outline, the frame and their margins meet.

    The outline's image is displaced by `shift_um`. None where they do not meet.
    """
    if not outline.rings:
        return None
    k = microscope.px_per_um
    cx, cy = axis_px(microscope)
    x_min, y_min, x_max, y_max = outline.bounds_um
    grow = margin_um * k
    columns = _meet(
        cx + k * (x_min + shift_um[0]) - grow,
        cx + k * (x_max + shift_um[0]) + grow,
        frame.column - grow,
        frame.column + frame.columns - 1 + grow,
    )
    rows = _meet(
        cy - k * (y_max + shift_um[1]) - grow,
        cy - k * (y_min + shift_um[1]) + grow,
        frame.row - grow,
        frame.row + frame.rows - 1 + grow,
    )
    if columns is None or rows is None:
        return None
    return PixelTile(
        row=rows[0], column=columns[0], rows=_fast(rows[1]), columns=_fast(columns[1])
    )


def to_world(
    tile: PixelTile, microscope: Microscope, shift_um: tuple[float, float]
) -> Tile:
    """Return where the tile lies on the scene before the shift, um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    return Tile(
        left_um=(tile.column - cx) * p - shift_um[0],
        bottom_um=(cy - (tile.row + tile.rows - 1)) * p - shift_um[1],
        width_um=tile.columns * p,
        height_um=tile.rows * p,
    )


def sample(
    values: ComplexArray, tile: PixelTile, rows: range, columns: range
) -> FloatArray:
    """Return the image at `rows` and `columns` of the frame from its coefficients."""
    bottom = tile.row + tile.rows - 1
    if _by_product_is_cheaper(values.shape, tile, rows, columns):
        y = (bottom - np.asarray(rows)) / tile.rows
        x = (np.asarray(columns) - tile.column) / tile.columns
        return _sample_by_product(values, y, x)
    image = _sample_by_fft(values, tile.rows, tile.columns)[::-1]
    r0, c0 = rows.start - tile.row, columns.start - tile.column
    return image[r0 : r0 + len(rows), c0 : c0 + len(columns)]


def axis_px(microscope: Microscope) -> tuple[float, float]:
    """Return (column, row) of the optical axis."""
    return ((microscope.width_px - 1) / 2, (microscope.height_px - 1) / 2)


def _meet(a: float, b: float, c: float, d: float) -> tuple[int, int] | None:
    """Return first integer and count of the meeting of [a, b] and [c, d]."""
    low, high = math.floor(max(a, c)), math.ceil(min(b, d))
    return None if high < low else (low, high - low + 1)


def _fast(count: int) -> int:
    """Return the next length that transforms fast."""
    size = fft.next_fast_len(count, real=True)
    if size is None:  # only if the length overflowed
        raise ValueError(f"no transform of length {count}")
    return size


def _common(a: int, a_count: int, b: int, b_count: int) -> range:
    return range(max(a, b), max(min(a + a_count, b + b_count), a, b))


def _by_product_is_cheaper(
    shape: tuple[int, ...], tile: PixelTile, rows: range, columns: range
) -> bool:
    """Compare operation counts of the two ways to sample."""
    product = len(rows) * shape[1] * (shape[0] + len(columns) / 2)
    pixels = tile.rows * tile.columns
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
