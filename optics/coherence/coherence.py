"""Scene to image in partially coherent light, without noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import ComplexArray, FloatArray, Point
from microplan.optics.coherence.abbe import (
    TransmissionSheet,
    band_per_um,
    centred,
    intensity,
)
from microplan.optics.coherence.source import SAMPLES, disc_source
from microplan.optics.outline.outline import Outline
from microplan.optics.render.pixels import choose_tile, sample, to_world
from microplan.optics.render.render import render
from microplan.optics.render.sampling import halo_gain, margin_um, pixel_gain
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.spectrum import Spectrum, spectrum
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction
from microplan.optics.transfer.wavefront import disc_shift_um
from microplan.optics.transfer.zernike import turns_of

# From here on the difference from incoherent light falls as 1 / coherence, within 3e-4
# of unit contrast (the edge's one-dimensional calculation, in the tests).
FULL_COHERENCE = 4.0
# as in `microplan.optics.render.render`: covers of one height above 1 by more overlap
_OVERLAP = 0.01
_LEAST_LAMP = 0.05  # over the lens' aperture: narrower ones show discs at one place


def render_coherent(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    coherence: float,
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    samples: int = SAMPLES,
) -> FloatArray:
    """Return the noise-free image of a scene in partially coherent light.

    Parameters
    ----------
    scene : Scene
        Layers in the world frame over a uniform background.
    microscope : Microscope
        The optical setting, with its wavefront error and halo; the camera's axis is
        the world's origin.
    focus_um : float
        World height of the plane in focus.
    coherence : float
        Aperture of the condenser over that of the objective. Small values are coherent
        and large ones incoherent; 0 means `microplan.optics.render.render.render`, as
        in a workcell.
    window : Window, optional
        The part of the frame wanted. Default: all.
    shift_um : (x, y)
        Displacement of the whole image, um in object space.
    samples : int
        Source points along a radius of the pupil; see
        `microplan.optics.coherence.source.source_error`.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped: a uniform field has its reflectance, even
        where `coherence` exceeds 1 and part of the light misses the objective.

    Raises
    ------
    ValueError
        If a number is not finite, or `coherence` negative, or `samples` below 1.

    Notes
    -----
    Faces are flat mirrors: they reflect the root of their reflectance, all in phase but
    for their heights, and light and image pass the same path. The lowest layer
    lies in the background's plane. One height is exact but for the source's samples
    and the tile's margin, where an endless edge costs 1 / (pi**2 `MARGIN`) = 2.5e-3 in
    coherent light. A higher layer blocks what the objective collects from below it,
    in its own plane; light from below beyond the objective's aperture and the higher
    layer's shade are left out, which costs up to .14 where edges of two heights meet.
    The wavefront error, with the signs of `microplan.optics.transfer.wavefront`, is the
    objective's towards the camera: to light from a point of the source it does nothing
    on the way in. Images are counted from `lit_disc_shift_um`, and the halo scatters
    what the lens shows.
    Above `FULL_COHERENCE` the difference from the incoherent image is that at
    `FULL_COHERENCE`, scaled down.

    References
    ----------
    Abbe's sum over the source: Born & Wolf (1999), Principles of Optics, section
    10.6.3; normalisation by the uniform field is ours.
    """
    _check(focus_um, coherence, shift_um, samples)
    frame = window or full(microscope)
    share = min(1.0, FULL_COHERENCE / coherence) if coherence > 0 else 0.0
    image = np.zeros((frame.rows, frame.columns))
    if share < 1:
        image += (1 - share) * render(
            scene, microscope, focus_um=focus_um, window=frame, shift_um=shift_um
        )
    if share > 0:
        image += share * _full(
            scene,
            microscope,
            focus_um,
            min(coherence, FULL_COHERENCE),
            frame,
            shift_um,
            samples,
        )
    white = Scene(layers=(), background=1.0)
    return image * render(white, microscope, focus_um=0.0, window=frame, light=light)


def _check(
    focus_um: float, coherence: float, shift_um: tuple[float, float], samples: int
) -> None:
    for name, value in (
        ("focus_um", focus_um), ("shift_um", shift_um[0]), ("shift_um", shift_um[1])
    ):  # fmt: skip
        if not math.isfinite(value):
            raise ValueError(f"{name} must be finite, got {value}")
    if not (coherence >= 0 and math.isfinite(coherence)):
        raise ValueError(f"coherence must be finite and >= 0, got {coherence}")
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")


def _full(
    scene: Scene,
    microscope: Microscope,
    focus_um: float,
    coherence: float,
    frame: Window,
    shift_um: tuple[float, float],
    samples: int,
) -> FloatArray:
    """Return the image by Abbe's sum, before the light's gain and gradient."""
    image = np.full((frame.rows, frame.columns), scene.background)
    layers = sorted(scene.layers, key=lambda layer: (layer.z_um, layer.name))
    rings = tuple(ring for layer in layers for ring in layer.outline.rings)
    margin = max(
        (margin_um(microscope, s.z_um - focus_um) for s in layers), default=0.0
    )
    tile = choose_tile(Outline(rings=rings), microscope, margin, frame, shift_um)
    if tile is None:
        return image
    world, box = to_world(tile, microscope, shift_um)
    band = band_per_um(world, microscope, coherence)
    spectra = [spectrum(layer.outline, world, band, box=box) for layer in layers]
    sheets = _sheets(layers, spectra, microscope, focus_um)
    flat = len(sheets) == 1 and sheets[0].z_um == 0
    # s and -s then give one image, if the wavefront error is odd
    odd = all(turns_of(noll) % 2 for noll, _ in microscope.wavefront)
    source = disc_source(coherence, samples, half=flat and odd)
    seen = intensity(sheets, math.sqrt(scene.background), world, microscope, source)
    pixels = sample(_camera(seen, microscope, coherence), tile)
    r0 = tile.rows.seen.start - frame.row
    c0 = tile.columns.seen.start - frame.column
    image[r0 : r0 + pixels.shape[0], c0 : c0 + pixels.shape[1]] = pixels
    return image


def _sheets(
    layers: Sequence[Layer],
    spectra: Sequence[Spectrum],
    microscope: Microscope,
    focus_um: float,
) -> list[TransmissionSheet]:
    """Join layers of one height unless they overlap; lowest first."""
    sheets: list[TransmissionSheet] = []
    pairs = zip(layers, spectra, strict=True)
    for z_um, group in itertools.groupby(pairs, key=lambda pair: pair[0].z_um):
        members = list(group)
        if len(members) > 1 and _overlap([s for _, s in members], microscope):
            parts = [[member] for member in members]
        else:
            parts = [members]
        sheets += [_sheet(part, z_um - focus_um) for part in parts]
    return sheets


def _sheet(members: Sequence[tuple[Layer, Spectrum]], z_um: float) -> TransmissionSheet:
    """Add up bodies side by side."""
    cover = sum(s.values for _, s in members)
    amplitude = sum(math.sqrt(each.reflectance) * s.values for each, s in members)
    return TransmissionSheet(
        z_um=z_um,
        cover=centred(np.asarray(cover, dtype=np.complex128)),
        amplitude=centred(np.asarray(amplitude, dtype=np.complex128)),
    )


def _overlap(spectra: Sequence[Spectrum], microscope: Microscope) -> bool:
    """Return whether indicators of one tile add up to more than 1 in focus."""
    J, K = spectra[0].orders
    tile = spectra[0].tile
    values = np.sum([s.values for s in spectra], axis=0)
    u = np.arange(J + 1) / tile.width_um
    v = np.r_[0 : K + 1, -K:0] / tile.height_um
    x = np.hypot(u, v[:, None]) / microscope.cutoff_per_um
    grid = np.zeros((2 * K + 2, J + 2), dtype=np.complex128)
    grid[np.r_[0 : K + 1, -K:0], : J + 1] = values * diffraction(x)
    total = np.fft.irfft2(grid, s=(2 * K + 2, 2 * J + 2)) * (2 * K + 2) * (2 * J + 2)
    return bool(total.max() > 1 + _OVERLAP)


def _camera(seen: Spectrum, microscope: Microscope, coherence: float) -> ComplexArray:
    """Scatter an intensity into the halo, integrate it over pixels; (2 K + 1, J + 1).

    Counted from where the lens shows the middle of a large disc in focus.
    """
    J, K = seen.orders
    up = np.r_[0 : K + 1, -K:0]
    across, along = pixel_gain(microscope, seen.tile, (J, K))
    gain = across * along[:, None]
    if microscope.halo is not None:
        gain *= halo_gain(microscope, seen.tile, (J, K))
    values = seen.values.astype(np.complex128) * gain[np.abs(up)]
    if microscope.wavefront:
        x_um, y_um = lit_disc_shift_um(microscope, coherence)
        u, v = np.arange(J + 1) / seen.tile.width_um, up / seen.tile.height_um
        values *= np.exp(2j * np.pi * (u * x_um + v[:, None] * y_um))
    return np.asarray(values)


def lit_disc_shift_um(microscope: Microscope, coherence: float) -> Point:
    """Return where the lens shows the middle of a large disc in focus, (x, y) um.

    By faint edges, which interfere with the direct light alone: as through a lamp as
    wide as the condenser. From a coherence of 1 on it is where incoherent light shows
    it. In coma of .05 waves edges of full contrast lie within .002 wavelength / A of
    that from a coherence of .5 on, and within .02 below.
    """
    share = min(max(coherence, _LEAST_LAMP), 1.0)
    return disc_shift_um(replace(microscope, lamp_aperture=share * microscope.aperture))
