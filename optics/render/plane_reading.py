"""Blurred layers of an image, read from planes in the outline's own frame.

For the many images of a look: they differ in the layers' poses, a little in focus and
zoom. A pixel is the mean of a plane's samples, squares themselves, at even points of
the pixel; how the body's squares are turned against the pixels is not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.compiled import compiled
from microplan.optics.outline.own_frame import own_frame
from microplan.optics.render.own_plane import (
    PlaneSetting,
    nodes_um,
    plane,
    plane_window,
)
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.sampling import Sampling, band_cut
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope

_OCTAVE = 16  # pitches of planes: samples are within 2.2 % of the pixel, or its halves
_BAND = 0.45  # cycles a sample at most: above, a cubic spline follows nothing
_FINEST = 2  # halvings of the pixel
# Points of an image: planes of more fill the memory, heights that vary needing many.
_MOST, _MOST_ALIKE = 1 << 18, 1 << 19
_POINT = 1e-6  # a pixel's light-sensitive share that makes it a point
_TAPS = 4  # samples of a cubic


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixels:
    """Where an image's pixels lie in a plane."""

    window: Window
    # (2, 3): the plane's column and row from 1, the window's column and row
    affine: FloatArray

    def read(self) -> Window:
        """Return the samples that the pixels read."""
        w = self.window
        ends = np.array([(1, x, y) for x in (-1, w.columns) for y in (-1, w.rows)])
        places = ends @ self.affine.T
        low, high = np.floor(places.min(axis=0)) - 2, np.ceil(places.max(axis=0)) + 3
        (column, row), (columns, rows) = low.tolist(), (high - low).tolist()
        return Window(
            column=int(column), row=int(row), columns=int(columns), rows=int(rows)
        )

    def turned(self) -> Window:
        """Return what they read however they are turned about their middle."""
        w = self.window
        middle = self.affine @ (1, (w.columns - 1) / 2, (w.rows - 1) / 2)
        column, row = np.floor(middle).astype(int).tolist()
        samples = math.hypot(*self.affine[:, 1])  # a pixel
        half = math.ceil(math.hypot(w.rows, w.columns) / 2 * samples)
        return Window(
            column=column - half, row=row - half, columns=2 * half, rows=2 * half
        )


def read_layer(
    layer: Layer,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str,
    window: Window,
    shift_um: tuple[float, float],
    sampling: Sampling,
) -> FloatArray | None:
    """Return a layer blurred at the pixels of a window, (rows, columns), 0..1.

    Arguments as in `microplan.optics.render.render.render`. None where planes would
    take longer or do not serve: lenses with a wavefront error, pixels with gaps.

    Notes
    -----
    The result hangs on the arguments alone, not on the planes that are kept. It differs
    from that of a transform by less than the band error of either (tested).
    """
    heights, weights = _heights(microscope, layer.z_um - focus_um)
    fit = _lens(microscope, model, min(heights), sampling)
    if fit is None or not layer.outline.rings:
        return None
    lens, halvings = fit
    most = _MOST if len(heights) > 1 else _MOST_ALIKE
    if window.rows * window.columns << 2 * max(halvings, 0) > most:
        return None
    turn, origin_um, own = own_frame(layer.outline)
    setting = PlaneSetting(own=own, lens=lens, model=model, sampling=_shared(sampling))
    frame = (origin_um[0] + shift_um[0], origin_um[1] + shift_um[1])
    affine = _affine(microscope, window, turn, frame) / lens.um_per_px
    pixels = _Pixels(window=window, affine=affine)
    found = np.zeros((window.rows, window.columns))
    held = plane_window(setting, max(heights), pixels.turned())
    if held is None:
        return found
    rows, columns = _slices(pixels.read(), held)
    if min(rows.stop - rows.start, columns.stop - columns.start) < _TAPS:
        return found
    spline = np.zeros((rows.stop - rows.start, columns.stop - columns.start), "f4")
    for z_um, weight in zip(heights, weights, strict=True):
        spline += np.float32(weight) * plane(setting, z_um, held)[rows, columns]
    affine[:, 0] -= (held.column + columns.start, held.row + rows.start)
    points = _points(microscope, lens, 1 << max(halvings, 0))
    _read(spline, affine, points, found)
    return found


def _heights(microscope: Microscope, z_um: float) -> tuple[list[float], list[float]]:
    """Return the heights of planes that count, um, and the weight of each."""
    found = [pair for pair in zip(*nodes_um(microscope, z_um), strict=True) if pair[1]]
    return [z_um for z_um, _ in found], [weight for _, weight in found]


def _lens(
    microscope: Microscope, model: str, z_um: float, sampling: Sampling
) -> tuple[Microscope, int] | None:
    """Return the lens with a pixel a sample, and how often samples halve the pixel.

    Less than 0 times where they are farther apart. None where a plane does not serve.
    """
    m = replace(microscope, magnification=1.0, width_px=1, height_px=1)
    is_point = m.fill_factor < _POINT
    if m.wavefront or not (is_point or m.fill_factor == 1):
        return None
    octave = round(_OCTAVE * math.log2(microscope.um_per_px)) / _OCTAVE
    lens = replace(m, pitch_um=2.0**octave)
    cut = band_cut(model, lens, z_um, sampling.band_error) * lens.cutoff_per_um
    if is_point:
        fine = math.floor(math.log2(_BAND / cut))
        return replace(lens, pitch_um=2.0**fine), 0
    halvings = math.ceil(math.log2(cut * lens.um_per_px / _BAND))
    if halvings > _FINEST:
        return None
    share = 4.0 ** min(halvings, 0)  # of a coarse sample's area is the pixel's
    pitch_um = lens.um_per_px / 2.0**halvings
    return replace(lens, pitch_um=pitch_um, fill_factor=share), halvings


def _shared(sampling: Sampling) -> Sampling:
    """Return what planes need of a sampling."""
    return Sampling(
        band_error=sampling.band_error,
        margin=sampling.margin,
        near=sampling.near,
        single=True,
    )


def _affine(
    microscope: Microscope,
    window: Window,
    turn: tuple[float, float],
    origin_um: tuple[float, float],
) -> FloatArray:
    """Return pixels' places in a turned frame, um, rows down, as `_Pixels` has them."""
    cx, cy = axis_px(microscope)
    p, (c, s) = microscope.um_per_px, turn
    x = (window.column - cx) * p - origin_um[0]
    y = (cy - window.row) * p - origin_um[1]
    return np.array([(c * x + s * y, c * p, -s * p), (s * x - c * y, s * p, c * p)])


def _slices(wanted: Window, held: Window) -> tuple[slice, slice]:
    """Return rows and columns of what is held that are wanted."""
    found = [
        slice(max(first, 0), max(min(first + count, most), 0))
        for first, count, most in (
            (wanted.row - held.row, wanted.rows, held.rows),
            (wanted.column - held.column, wanted.columns, held.columns),
        )
    ]
    return found[0], found[1]


def _points(microscope: Microscope, lens: Microscope, count: int) -> FloatArray:
    """Return where a pixel's points lie along an axis, (count,) pixels.

    With the samples' own squares they spread as the pixel does.
    """
    if count == 1:
        return np.zeros(1)
    sample = lens.um_per_px / microscope.um_per_px
    apart = math.sqrt((1 - sample**2) / (count**2 - 1))
    spread: FloatArray = apart * (np.arange(float(count)) - (count - 1) / 2)
    return spread


@compiled
def _weights(t: float) -> tuple[float, float, float, float]:
    """Return what four coefficients of a spline count, 0 <= t < 1 past the second."""
    s = 1 - t
    return (
        s * s * s / 6,
        2 / 3 - t * t * (1 - t / 2),
        2 / 3 - s * s * (1 - s / 2),
        t * t * t / 6,
    )


@compiled
def _read(
    spline: Float32Array, to_plane: FloatArray, points: FloatArray, out: FloatArray
) -> None:
    """Write means of a spline over points of each pixel, (rows, columns).

    The spline has coefficients (R, C), and is 0 outside.
    """
    rows, columns = spline.shape
    share = 1 / points.size**2
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for down in points:
                for right in points:
                    a, b = j + right, i + down
                    u = to_plane[0, 0] + to_plane[0, 1] * a + to_plane[0, 2] * b
                    v = to_plane[1, 0] + to_plane[1, 1] * a + to_plane[1, 2] * b
                    if not (1 <= u < columns - 2 and 1 <= v < rows - 2):
                        continue
                    c, r = int(u), int(v)
                    w0, w1, w2, w3 = _weights(u - c)
                    h = _weights(v - r)
                    for k in range(4):
                        line = spline[r - 1 + k]
                        total += h[k] * (
                            w0 * line[c - 1] + w1 * line[c]
                            + w2 * line[c + 1] + w3 * line[c + 2]
                        )  # fmt: skip
            out[i, j] = total * share
