"""Scene to image: what the camera sees, without noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from optics.microscope import Microscope
from optics.models import find_model, tabulate
from optics.pixels import PixelTile, axis_px, choose_tile, sample, to_world
from optics.sampling import Sampling, band_cut, margin_um
from optics.scene import Illumination, Layer, Scene, Window
from optics.spectrum import Spectrum, spectrum

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

# Coverages of one height add up to 1 at most unless bodies overlap; the rest is error
# of the band and the margin.
_OVERLAP = 0.01
_USUAL = Sampling()


def render(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    also: Sequence[Covered] = (),
    sampling: Sampling = _USUAL,
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
        The defocus law, a key of `optics.models.MODELS`.
    window : Window, optional
        The part of the frame wanted; it may reach beyond the frame. Default: all.
    light : Illumination, optional
        Gain and gradient of the light; the gradient refers to the full field.
    shift_um : (x, y)
        Displacement of the whole image, um in object space.
    also : sequence of Covered
        More layers of the scene, blurred already by `cover` with the same arguments.
    sampling : Sampling
        Band and margin to compute with.

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
    frame = window or _full(microscope)
    fresh = cover(
        scene.layers,
        microscope,
        focus_um=focus_um,
        model=model,
        window=frame,
        shift_um=shift_um,
        sampling=sampling,
    )
    lit = _light(microscope, frame, light or Illumination())
    return _laid([*also, *fresh], scene.background, frame) * lit


@dataclass(frozen=True, slots=True, kw_only=True)
class Covered:
    """A layer with its blurred indicator at the pixels of a window."""

    layer: Layer
    coverage: FloatArray  # (rows, columns), 0..1 but for errors of band and margin


def cover(
    layers: Sequence[Layer],
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    sampling: Sampling = _USUAL,
) -> tuple[Covered, ...]:
    """Return layers blurred, for images that share them; arguments as in `render`."""
    find_model(model)
    _check((focus_um,), shift_um)
    frame = window or _full(microscope)
    prepared = [
        _prepare(layer, microscope, (focus_um,), model, frame, shift_um, sampling)
        for layer in layers
    ]
    return tuple(p.covered(microscope, focus_um) for p in prepared)


def render_stack(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: Sequence[float],
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return images of a scene at several focus heights, (planes, rows, columns).

    Spectra are computed once for all planes; else like `render`. The margin is that
    of the plane most out of focus, so a plane agrees with `render` within the
    predicted errors, not bit by bit.
    """
    find_model(model)
    _check(focus_um, shift_um)
    frame = window or _full(microscope)
    prepared = [
        _prepare(layer, microscope, focus_um, model, frame, shift_um, sampling)
        for layer in scene.layers
    ]
    lit = _light(microscope, frame, light or Illumination())
    images = [
        _laid([p.covered(microscope, z) for p in prepared], scene.background, frame)
        for z in focus_um
    ]
    return np.stack(images) * lit


@dataclass(frozen=True, slots=True, kw_only=True)
class _Prepared:
    """A layer's spectrum on its tile, ready for any focus of the call."""

    layer: Layer
    model: str
    band_error: float
    frame: Window
    tile: PixelTile | None  # None where nothing of the layer comes near
    spectrum: Spectrum | None

    def covered(self, microscope: Microscope, focus_um: float) -> Covered:
        """Return the layer with its blurred indicator."""
        image = np.zeros((self.frame.rows, self.frame.columns))
        if self.tile is None or self.spectrum is None:
            return Covered(layer=self.layer, coverage=image)
        z_um = self.layer.z_um - focus_um
        cut = band_cut(self.model, microscope, z_um, self.band_error)
        part = self.spectrum.cut(cut * microscope.cutoff_per_um)
        blurred = _filter(part, microscope, self.model, z_um, cut)
        r0 = self.tile.rows.seen.start - self.frame.row
        c0 = self.tile.columns.seen.start - self.frame.column
        seen = sample(blurred, self.tile)
        rows, columns = seen.shape
        image[r0 : r0 + rows, c0 : c0 + columns] = seen
        return Covered(layer=self.layer, coverage=image)


def _full(microscope: Microscope) -> Window:
    return Window(
        row=0, column=0, rows=microscope.height_px, columns=microscope.width_px
    )


def _check(focus_um: Sequence[float], shift_um: tuple[float, float]) -> None:
    if not focus_um:
        raise ValueError("focus_um must hold at least one height")
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
    sampling: Sampling,
) -> _Prepared:
    """Choose the layer's tile and transform its outline."""
    defocus = [layer.z_um - focus for focus in focus_um]
    margin = max(margin_um(microscope, z, sampling.margin) for z in defocus)
    tile = choose_tile(layer.outline, microscope, margin, frame, shift_um)
    found = None
    if tile is not None:
        cut = max(band_cut(model, microscope, z, sampling.band_error) for z in defocus)
        world, box = to_world(tile, microscope, shift_um)
        top_per_um = cut * microscope.cutoff_per_um
        found = spectrum(layer.outline, world, top_per_um, box=box)
    return _Prepared(
        layer=layer,
        model=model,
        band_error=sampling.band_error,
        frame=frame,
        tile=tile,
        spectrum=found,
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


def _laid(layers: Sequence[Covered], background: float, frame: Window) -> FloatArray:
    """Return the layers laid over a background from the lowest to the highest."""
    image = np.full((frame.rows, frame.columns), background)
    ordered = sorted(layers, key=lambda c: (c.layer.z_um, c.layer.name))
    for _, group in itertools.groupby(ordered, key=lambda c: c.layer.z_um):
        _blend(image, list(group))
    return image


def _blend(image: FloatArray, group: list[Covered]) -> None:
    """Lay the layers of one height over `image`, in place."""
    total = sum((each.coverage for each in group), np.zeros_like(image))
    if total.max() <= 1 + _OVERLAP:  # bodies side by side: exact for one height
        image *= 1 - total
        for each in group:
            image += each.layer.reflectance * each.coverage
        return
    for each in group:
        image *= 1 - each.coverage
        image += each.layer.reflectance * each.coverage


def _light(microscope: Microscope, frame: Window, light: Illumination) -> FloatArray:
    """Return the illumination of the frame's pixels, (rows, columns)."""
    cx, cy = axis_px(microscope)
    x = (np.arange(frame.columns) + frame.column - cx) / microscope.width_px
    y = (cy - np.arange(frame.rows) - frame.row) / microscope.height_px
    lit: FloatArray = light.gain * (
        1 + light.gradient_x * x + light.gradient_y * y[:, None]
    )
    return lit
