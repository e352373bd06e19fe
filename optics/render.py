"""Scene to image: what the camera sees, without noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from optics.microscope import Microscope
from optics.otf import find_model, tabulate
from optics.sampling import band_cut, margin_um
from optics.scene import Illumination, Layer, Scene, Window
from optics.spectrum import Spectrum, Tile, spectrum

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

# Coverages of one height add up to 1 at most unless bodies overlap; the rest is error
# of the band and the margin.
_OVERLAP = 0.01


def render(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "hopkins",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the noise-free image of a scene.

    Parameters
    ----------
    scene : Scene
        Layers in the world frame over a uniform background.
    microscope : Microscope
        The optical setting; the camera's axis is the world's origin.
    focus_um : float
        World height of the plane in focus.
    model : str
        The defocus law, a key of `optics.otf.MODELS`.
    window : Window, optional
        The part of the frame wanted; it may reach beyond the frame. Default: all.
    light : Illumination, optional
        Gain and gradient of the light; the gradient refers to the full field.
    shift_um : (x, y)
        Displacement of the whole image, um in object space.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped; pixels are integrals over their area.

    Raises
    ------
    ValueError
        If the model is unknown or a number is not finite.

    Notes
    -----
    Layers are blurred each with its own defocus and blended from the lowest to the
    highest, image = (1 - a) image + reflectance a. Layers of equal height share one
    step. Errors of band and margin: `optics.sampling`.
    """
    image: FloatArray = render_stack(
        scene,
        microscope,
        focus_um=(focus_um,),
        model=model,
        window=window,
        light=light,
        shift_um=shift_um,
    )[0]
    return image


def render_stack(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: Sequence[float],
    model: str = "hopkins",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return images of a scene at several focus heights, (planes, rows, columns).

    Spectra are computed once for all planes; else like `render`. The margin is that
    of the plane most out of focus, so a plane agrees with `render` within the
    predicted errors, not bit by bit.
    """
    find_model(model)
    _check(focus_um, shift_um)
    frame = _full(microscope) if window is None else window
    groups = [
        [_prepare(layer, microscope, focus_um, model, frame, shift_um) for layer in g]
        for _, g in itertools.groupby(_by_height(scene), key=lambda layer: layer.z_um)
    ]
    lit = _light(microscope, frame, light or Illumination())
    images = np.empty((len(focus_um), frame.rows, frame.columns))
    for plane, focus in enumerate(focus_um):
        image = images[plane]
        image[:] = scene.background
        for group in groups:
            _blend(image, [(p.layer, p.coverage(microscope, focus)) for p in group])
        images[plane] *= lit
    return images


@dataclass(frozen=True, slots=True, kw_only=True)
class _Prepared:
    """A layer's spectrum on its tile, ready for any focus of the call."""

    layer: Layer
    model: str
    frame: Window
    tile: _PixelTile | None  # None where nothing of the layer comes near
    spectrum: Spectrum | None

    def coverage(self, microscope: Microscope, focus_um: float) -> FloatArray:
        """Return the blurred indicator at the pixels of the frame."""
        image = np.zeros((self.frame.rows, self.frame.columns))
        if self.tile is None or self.spectrum is None:
            return image
        z_um = self.layer.z_um - focus_um
        cut = band_cut(self.model, microscope, z_um)
        part = self.spectrum.cut(cut * microscope.cutoff_per_um)
        blurred = _filter(part, microscope, self.model, z_um, cut)
        rows, columns = self.tile.overlap(self.frame)
        if rows and columns:
            r0, c0 = rows.start - self.frame.row, columns.start - self.frame.column
            image[r0 : r0 + len(rows), c0 : c0 + len(columns)] = _sample(
                blurred, self.tile, rows, columns
            )
        return image


@dataclass(frozen=True, slots=True, kw_only=True)
class _PixelTile:
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


def _by_height(scene: Scene) -> list[Layer]:
    return sorted(scene.layers, key=lambda layer: (layer.z_um, layer.name))


def _full(microscope: Microscope) -> Window:
    return Window(
        row=0, column=0, rows=microscope.height_px, columns=microscope.width_px
    )


def _check(focus_um: Sequence[float], shift_um: tuple[float, float]) -> None:
    for name, values in (("focus_um", focus_um), ("shift_um", shift_um)):
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"{name} must be finite, got {values}")


def _prepare(
    layer: Layer,
    microscope: Microscope,
    focus_um: Sequence[float],
    model: str,
    frame: Window,
    shift_um: tuple[float, float],
) -> _Prepared:
    """Choose the layer's tile and transform its outline."""
    defocus = [layer.z_um - focus for focus in focus_um]
    margin = max((margin_um(microscope, z) for z in defocus), default=0.0)
    tile = _choose_tile(layer, microscope, margin, frame, shift_um)
    found = None
    if tile is not None:
        cut = max(band_cut(model, microscope, z) for z in defocus)
        world = _world(tile, microscope, shift_um)
        found = spectrum(layer.outline, world, cut * microscope.cutoff_per_um)
    return _Prepared(layer=layer, model=model, frame=frame, tile=tile, spectrum=found)


def _choose_tile(
    layer: Layer,
    microscope: Microscope,
    margin: float,
    frame: Window,
    shift_um: tuple[float, float],
) -> _PixelTile | None:
    """Return the pixels where the layer, the frame and their margins meet."""
    if not layer.outline.rings:
        return None
    k = microscope.px_per_um
    cx, cy = _axis(microscope)
    x_min, y_min, x_max, y_max = layer.outline.bounds_um
    grow = margin * k
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
    return _PixelTile(
        row=rows[0], column=columns[0], rows=_fast(rows[1]), columns=_fast(columns[1])
    )


def _axis(microscope: Microscope) -> tuple[float, float]:
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


def _world(
    tile: _PixelTile, microscope: Microscope, shift_um: tuple[float, float]
) -> Tile:
    """Return where the tile lies on the scene before the shift, um."""
    cx, cy = _axis(microscope)
    p = microscope.um_per_px
    return Tile(
        left_um=(tile.column - cx) * p - shift_um[0],
        bottom_um=(cy - (tile.row + tile.rows - 1)) * p - shift_um[1],
        width_um=tile.columns * p,
        height_um=tile.rows * p,
    )


def _filter(
    part: Spectrum, microscope: Microscope, model: str, z_um: float, cut: float
) -> ComplexArray:
    """Multiply a spectrum by transfer and pixel; (2 K + 1, J + 1) again."""
    J, K = part.orders
    u = np.arange(J + 1) / part.tile.width_um
    v = np.arange(K + 1) / part.tile.height_um
    x = np.sqrt(u**2 + v[:, None] ** 2) / microscope.cutoff_per_um
    table = tabulate(model, microscope, z_um, cut)
    gain = np.where(x <= cut, table.read(np.minimum(x, cut)), 0.0)
    side = microscope.um_per_px * math.sqrt(microscope.fill_factor)
    gain *= np.sinc(u * side) * np.sinc(v * side)[:, None]
    filtered = np.empty_like(part.values)
    filtered[: K + 1] = part.values[: K + 1] * gain
    filtered[K + 1 :] = part.values[K + 1 :] * gain[:0:-1]
    return filtered


def _sample(
    values: ComplexArray, tile: _PixelTile, rows: range, columns: range
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


def _by_product_is_cheaper(
    shape: tuple[int, ...], tile: _PixelTile, rows: range, columns: range
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


def _common(a: int, a_count: int, b: int, b_count: int) -> range:
    return range(max(a, b), max(min(a + a_count, b + b_count), a, b))


def _blend(image: FloatArray, group: list[tuple[Layer, FloatArray]]) -> None:
    """Lay the layers of one height over `image`, in place."""
    total = sum((cover for _, cover in group), np.zeros_like(image))
    if total.max() <= 1 + _OVERLAP:  # bodies side by side: exact for one height
        image *= 1 - total
        for layer, cover in group:
            image += layer.reflectance * cover
        return
    for layer, cover in group:
        image *= 1 - cover
        image += layer.reflectance * cover


def _light(microscope: Microscope, frame: Window, light: Illumination) -> FloatArray:
    """Return the illumination of the frame's pixels, (rows, columns)."""
    cx, cy = _axis(microscope)
    x = (np.arange(frame.columns) + frame.column - cx) / microscope.width_px
    y = (cy - np.arange(frame.rows) - frame.row) / microscope.height_px
    lit: FloatArray = light.gain * (
        1 + light.gradient_x * x + light.gradient_y * y[:, None]
    )
    return lit
