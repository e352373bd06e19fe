"""Blurred layers of an image, read from planes in the outline's own frame.

For the many images of a look, which differ in the layers' poses, a little in focus and
zoom: planes of few heights serve them all, and are kept. A pixel is the mean of samples
at even points, each of a small square; how that is turned against it is not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import ndimage

from microplan.arrays import Float32Array, FloatArray
from microplan.compiled import compiled
from microplan.optics.outline.outline import Outline
from microplan.optics.outline.own_frame import OwnEdges, own_edges, own_frame
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.sampling import Sampling, band_cut, margin_um
from microplan.optics.render.scene import Layer, Window
from microplan.optics.render.tiled_layer import make_part
from microplan.optics.render.view_range import ImageView, Range
from microplan.optics.transfer.lru import Recent
from microplan.optics.transfer.microscope import Microscope

_OCTAVE = 16  # pitches of planes: samples are within 2.2 % of the pixel, or its halves
_BAND = 0.45  # cycles a sample at most: above, a cubic spline follows nothing
_FINEST = 2  # halvings of the pixel
_MOST, _MOST_ALIKE = 1 << 18, 1 << 19  # points of an image: a limit to memory
_POINT = 1e-6  # a pixel's light-sensitive share that makes it a point
_TAPS = 4  # samples of a cubic
_SHARP = 2.0  # depths of field within which errors are several times as large
_HELD_BYTES = 3 << 25  # of planes
# Samples a side of planes that are made all over, wherever they are wanted; of bodies
# beside the image, which sees other parts of them when they turn
_WHOLE, _WHOLE_BESIDE = 384, 768
_EVEN = 64  # samples: others end at whole multiples, areas nearly alike share planes
_RIM = 12  # samples beyond: a spline's ends are felt by .27 a sample
# A cubic through four heights errs most where the blur's rim passes an edge: heights
# lie so many depths of field apart, or so much of their distance from the focus.
_DEPTHS, _SHARE = 0.3, 0.025


@dataclass(frozen=True, slots=True, kw_only=True)
class _Planes:
    """What planes of one layer share."""

    own: OwnEdges
    lens: Microscope  # with a pixel a sample, of an even pitch
    model: str
    sampling: Sampling


_PLANES: Recent[Float32Array] = Recent(_HELD_BYTES, lambda found: found.nbytes)


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
        ends = np.stack([low, high - low]).astype(int).tolist()
        (column, row), (columns, rows) = ends
        return Window(column=column, row=row, columns=columns, rows=rows)

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
    take longer or do not serve: layers near focus, lenses with a wavefront error or a
    halo, pixels with gaps.

    Notes
    -----
    The result hangs on the arguments alone, not on the planes that are kept. It differs
    from that of a transform by less than the band error of either (tested).
    """
    z_um = layer.z_um - focus_um
    heights, weights = _heights(microscope, z_um)
    is_sharp = abs(z_um) < _SHARP * microscope.wave_depth_um
    fit = None if is_sharp else _lens(microscope, model, min(heights), sampling)
    if fit is None or not layer.outline.rings:
        return None
    lens, halvings = fit
    most = _MOST if len(heights) > 1 else _MOST_ALIKE
    if window.rows * window.columns << 2 * max(halvings, 0) > most:
        return None
    turn, origin_um, own = own_frame(layer.outline)
    setting = _Planes(own=own, lens=lens, model=model, sampling=_shared(sampling))
    frame = (origin_um[0] + shift_um[0], origin_um[1] + shift_um[1])
    affine = _affine(microscope, window, turn, frame) / lens.um_per_px
    pixels = _Pixels(window=window, affine=affine)
    found = np.zeros((window.rows, window.columns))
    held = _held_window(setting, max(heights), pixels.turned())
    if held is None:
        return found
    rows, columns = _slices(pixels.read(), held)
    if min(rows.stop - rows.start, columns.stop - columns.start) < _TAPS:
        return found
    spline = np.zeros((rows.stop - rows.start, columns.stop - columns.start), "f4")
    for z_um, weight in zip(heights, weights, strict=True):
        spline += np.float32(weight) * _plane(setting, z_um, held)[rows, columns]
    affine[:, 0] -= (held.column + columns.start, held.row + rows.start)
    points = _points(microscope, lens, 1 << max(halvings, 0))
    _read(spline, affine, points, found)
    return found


def _heights(microscope: Microscope, z_um: float) -> tuple[list[float], list[float]]:
    """Return the heights of planes that count, um, and the weight of each."""
    found = [pair for pair in zip(*_nodes_um(microscope, z_um), strict=True) if pair[1]]
    return [z_um for z_um, _ in found], [weight for _, weight in found]


def _lens(
    microscope: Microscope, model: str, z_um: float, sampling: Sampling
) -> tuple[Microscope, int] | None:
    """Return the lens with a pixel a sample, and how often samples halve the pixel.

    Less than 0 times where they are farther apart. None where a plane does not serve.
    """
    m = replace(microscope, magnification=1.0, width_px=1, height_px=1)
    is_point = m.fill_factor < _POINT
    if m.wavefront or m.halo or not (is_point or m.fill_factor == 1):
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


def _nodes_um(lens: Microscope, z_um: float) -> tuple[list[float], list[float]]:
    """Return four heights about a defocus z, um, and the weight of each [1].

    Heights are even in asinh z; those below 0 are blurred as those above.
    """
    scale = _DEPTHS / _SHARE * lens.wave_depth_um
    place = math.asinh(abs(z_um) / scale) / _SHARE
    first = math.floor(place)
    t = place - first
    heights = [abs(scale * math.sinh(_SHARE * (first + k))) for k in (-1, 0, 1, 2)]
    return heights, [
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ]


def _held_window(setting: _Planes, most_um: float, wanted: Window) -> Window | None:
    """Return the samples of planes up to a defocus, where they are wanted.

    None where the layer is not seen. Column c and row r lie at (c, -r) steps.
    """
    step = setting.lens.um_per_px
    margin = margin_um(setting.lens, most_um, setting.sampling.margin)
    left, low, right, high = own_edges(setting.own).bounds_um
    across = _even((left - margin) / step, (right + margin) / step)
    down = _even((-high - margin) / step, (margin - low) / step)
    aside = math.hypot(
        wanted.column + wanted.columns / 2 - (left + right) / 2 / step,
        wanted.row + wanted.rows / 2 + (low + high) / 2 / step,
    )
    whole = _WHOLE if aside < wanted.columns / 2 else _WHOLE_BESIDE
    if max(len(across), len(down)) > whole:
        seen = (_even(wanted.column, wanted.column + wanted.columns),
                _even(wanted.row, wanted.row + wanted.rows))  # fmt: skip
        across, down = _common(across, seen[0]), _common(down, seen[1])
    if not across or not down:
        return None
    return Window(
        column=across.start, row=down.start, columns=len(across), rows=len(down)
    )


def _even(low: float, high: float) -> range:
    """Return samples all about two ends, to whole multiples."""
    first = _EVEN * math.floor((low - _RIM) / _EVEN)
    return range(first, _EVEN * math.ceil((high + _RIM) / _EVEN))


def _common(one: range, other: range) -> range:
    """Return the samples that are in both."""
    return range(max(one.start, other.start), min(one.stop, other.stop))


def _plane(setting: _Planes, z_um: float, window: Window) -> Float32Array:
    """Return a layer `z_um` out of focus as a cubic spline's coefficients.

    (rows, columns), 0..1 but for errors of band and margin.
    """
    key = (setting, z_um, window)
    return _PLANES.get(key, partial(_blurred, setting, z_um, window))


def _blurred(setting: _Planes, z_um: float, window: Window) -> Float32Array:
    """Return a plane, not to be changed."""
    part = make_part(
        Layer(name="", outline=Outline(rings=()), z_um=z_um, reflectance=0.0),
        own_edges(setting.own),
        setting.lens,
        reach=Range(focus_um=(0.0, 0.0)),
        model=setting.model,
        window=window,
        sampling=setting.sampling,
    )
    found = np.zeros((window.rows, window.columns), dtype=np.float32)
    view = ImageView(microscope=setting.lens, focus_um=0.0)
    patch = None if part is None else part.patch(window, view)
    if patch is not None:
        found[patch.rows, patch.columns] = patch.coverage
    spline: Float32Array = ndimage.spline_filter(
        found, order=3, output=np.float32, mode="mirror"
    )
    spline.setflags(write=False)
    return spline


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
