"""Tiles of whole camera pixels, at which spectra are sampled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import Box
from microplan.optics.outline.clip import EdgeArrays
from microplan.optics.outline.outline import Outline
from microplan.optics.render.pruned_ifft import (
    Coefficients,
    Factors,
    Samples,
    Space,
    fast_length,
    fold,
    waves_at,
    weigh,
)
from microplan.optics.render.scene import Window
from microplan.optics.render.spectrum import Tile
from microplan.optics.transfer.microscope import Microscope

# Complex products in the time of one butterfly a sample, by which a matrix product is
# chosen: measured .5 to 1.2 with one thread, 60 x 60 to 480 x 640 pixels.
_PRODUCT_GAIN = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelAxis:
    """One axis of a tile, in pixels of the frame."""

    start: int  # the pixel of the first sample
    count: int  # samples in a period
    seen: range  # pixels of the window that may be read
    cut: tuple[float, float] | None  # where the outline is cut; None for the period


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelTile:
    """A tile whose samples are camera pixels."""

    columns: PixelAxis
    rows: PixelAxis  # down the frame


def choose_tile(
    outline: Outline | EdgeArrays,
    microscope: Microscope,
    margin_um: float,
    frame: Window,
    shift_um: tuple[float, float],
    *,
    apart_um: float | None = None,
) -> PixelTile | None:
    """Return the tile on which an outline's image can be computed.

    Parameters
    ----------
    outline : Outline or EdgeArrays
        The body, um; its image is displaced by `shift_um`.
    margin_um : float
        How far light spreads.
    frame : Window
        The pixels wanted.
    shift_um : (x, y)
        Displacement of the image.
    apart_um : float, optional
        How far from the pixels seen the outline is cut and repeated. Default: the
        margin.

    Returns
    -------
    PixelTile or None
        Every pixel within the margin of the outline is seen. None where there is none.
    """
    if _is_empty(outline):
        return None
    k = microscope.px_per_um
    cx, cy = axis_px(microscope)
    x_min, y_min, x_max, y_max = outline.bounds_um
    margin = margin_um * k
    apart = margin if apart_um is None else apart_um * k
    columns = _span(
        (cx + k * (x_min + shift_um[0]), cx + k * (x_max + shift_um[0])),
        (frame.column, frame.column + frame.columns - 1),
        margin,
        apart,
    )
    rows = _span(
        (cy - k * (y_max + shift_um[1]), cy - k * (y_min + shift_um[1])),
        (frame.row, frame.row + frame.rows - 1),
        margin,
        apart,
    )
    if columns is None or rows is None:
        return None
    return PixelTile(columns=columns, rows=rows)


def _span(
    body: tuple[float, float], wanted: tuple[int, int], margin: float, apart: float
) -> PixelAxis | None:
    """Choose one axis of a tile; all in pixels."""
    low, high = body
    first = max(wanted[0], math.floor(low - margin))
    last = min(wanted[1], math.ceil(high + margin))
    if last < first:
        return None
    seen = range(first, last + 1)
    # a body farther away than `apart` is cut to nothing, at the tile's end
    left = min(max(low, first - apart), last + apart)
    right = max(min(high, last + apart), first - apart)
    start = math.floor(min(left, first))
    if left > low and right < high:  # the body fills the period and runs on
        return PixelAxis(
            start=start, count=fast_length(right - start), seen=seen, cut=None
        )
    period = max(right - first, last - left) + apart
    count = fast_length(max(period, max(right, last) - start + 2))
    whole = left == low and right == high
    cut = None if whole else (left, right)
    return PixelAxis(start=start, count=count, seen=seen, cut=cut)


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


def sample(values: Coefficients, tile: PixelTile) -> Samples:
    """Return the image at the pixels seen, (rows, columns), from its coefficients."""
    gain = np.ones((values.shape[0] // 2 + 1, values.shape[1]), dtype=np.float32)
    return sample_part(values, gain, tile, tile.rows.seen, tile.columns.seen)


def sample_part(
    values: Coefficients,
    gain: Samples,
    tile: PixelTile,
    rows: range,
    columns: range,
    *,
    extra: Factors | None = None,
    space: Space | None = None,
) -> Samples:
    """Return the image at some pixels of the frame, all inside one period.

    Parameters
    ----------
    values : (2 K + 1, J + 1) complex array
        Coefficients as in `microplan.optics.render.spectrum.Spectrum`.
    gain : (k + 1, j + 1) float array
        An even gain by which they are multiplied and to whose orders they are cut.
    tile : PixelTile
        The period they belong to.
    rows, columns : range
        Pixels of the frame.
    extra : Factors, optional
        Of what is added to the image, in the precision of `values`.
    space : Space, optional
        Where the work is done; the result may lie in it.

    Returns
    -------
    (len(rows), len(columns)) float array
        In the precision of `values`.
    """
    x, y = tile.columns, tile.rows
    bottom = y.start + y.count - 1
    shape = (2 * gain.shape[0] - 1, gain.shape[1])
    if _by_product_is_cheaper(shape, tile, len(rows), len(columns)):
        up = (bottom - np.asarray(rows)) / y.count
        right = (np.asarray(columns) - x.start) / x.count
        found = waves_at(weigh(values, gain), up, right)
        if extra is not None:
            found += extra[0] @ extra[1]
        return found
    lines = range(bottom - rows.stop + 1, bottom - rows.start + 1)
    along = range(columns.start - x.start, columns.stop - x.start)
    period = (y.count, x.count)
    return fold(values, gain, period, lines, along, extra=extra, space=space)


def axis_px(microscope: Microscope) -> tuple[float, float]:
    """Return (column, row) of the optical axis."""
    return ((microscope.width_px - 1) / 2, (microscope.height_px - 1) / 2)


def _is_empty(outline: Outline | EdgeArrays) -> bool:
    if isinstance(outline, Outline):
        return not outline.rings
    return not (outline.segments.size or outline.arcs.size)


def _by_product_is_cheaper(
    shape: tuple[int, ...], tile: PixelTile, rows: int, columns: int
) -> bool:
    """Compare operation counts of the two methods of sampling."""
    product = rows * shape[1] * (shape[0] + columns / 2)
    upwards = shape[1] * tile.rows.count * math.log2(max(tile.rows.count, 2))
    along = rows * tile.columns.count * math.log2(max(tile.columns.count, 2)) / 2
    return product < _PRODUCT_GAIN * (upwards + along)
