"""Images of a plane by waves: a sampled pupil, exact phase of defocus, pixels."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from microplan.arrays import ComplexArray, FloatArray, IntArray
from microplan.executor.simulated.imaging.imaging_view import (
    Halo,
    ImagingView,
    LampLevel,
)
from microplan.executor.simulated.imaging.wavefront import lens_waves

LEAST_TILE_UM = 90.0  # at A = .42 the pupil is 63 cells wide to each side
TAPS = 8  # of the interpolation between fine samples
KAISER = 6.0  # of its window: 1e-4 at the band of a fine grid


def point_spread(
    shape: tuple[int, int], step_um: float, view: ImagingView, defocus_um: float
) -> FloatArray:
    """Return the image of a point, its middle at [0, 0], of sum 1.

    The pupil is sampled on the frequencies of the grid: inside the aperture the wave
    has the phase 2 pi z (sqrt(n**2 - (wavelength nu)**2) - n) / wavelength. Incoherent
    light adds intensities. A wavefront error W enters as exp(2 pi i W) where a body
    above the focus has a positive phase: here all phases are the negative of that, and
    the pupil is turned by pi, which leaves intensities as they are.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the grid, which is a periodic tile; rows go up.
    step_um : float
        Between its points, at most wavelength / (4 A).
    view : ImagingView
        Its aperture, wavelength, index and wavefront error.
    defocus_um : float
        Height of the plane less the focus; the sign matters to a wavefront error only.
    """
    if step_um > view.wavelength_um / (4 * view.aperture):
        raise ValueError(f"a grid of {step_um} um aliases the image of a point")
    down, across = (np.fft.fftfreq(count, step_um) for count in shape)
    square = (down[:, None] ** 2 + across**2) * view.wavelength_um**2
    cell = view.wavelength_um / (step_um * math.sqrt(shape[0] * shape[1]))
    inside = np.flatnonzero(square.ravel() < (view.aperture + cell) ** 2)
    square = square.ravel()[inside]
    rim = np.clip((view.aperture - np.sqrt(square)) / cell + 0.5, 0.0, 1.0)  # of a cell
    n = view.medium_index
    path = -square / (np.sqrt(np.maximum(n**2 - square, 0.0)) + n)
    phase = 2 * math.pi * defocus_um / view.wavelength_um * path
    if view.wavefront:
        row, column = np.divmod(inside, shape[1])
        scale = -view.wavelength_um / view.aperture
        x, y = (scale * v[k].astype(float) for v, k in ((across, column), (down, row)))
        waves = lens_waves(view, x, y)
        phase = phase - 2 * math.pi * waves
    pupil = np.zeros(shape, dtype=np.complex64)
    pupil.ravel()[inside] = rim * np.exp(1j * phase)
    wave = np.fft.ifft2(pupil)
    light = wave.real.astype(float) ** 2 + wave.imag.astype(float) ** 2
    spread: FloatArray = light / light.sum()
    return spread


def blurred(
    plane: FloatArray, step_um: float, view: ImagingView, defocus_um: float
) -> FloatArray:
    """Return what pixels see of a plane, at all its points, (rows, columns).

    Parameters
    ----------
    plane : (rows, columns) float array
        Radiance, averaged over spots of a diameter of one step; a periodic tile.
    step_um, view, defocus_um
        As in `point_spread`; the view's pixels integrate over their area.
    """
    rows, columns = plane.shape
    lens = replace(
        view, focus_um=0.0, shift_um=(0.0, 0.0), lamp=LampLevel(), halo=Halo()
    )
    transfer = _transfer((rows, columns), step_um, lens, defocus_um)
    down = np.fft.fftfreq(rows, step_um)[:, None]
    across = np.fft.rfftfreq(columns, step_um)
    side_um = math.sqrt(view.fill_factor) / view.px_per_um
    pixel = np.sinc(down * side_um) * np.sinc(across * side_um)
    # edges were drawn as ramps one step wide: undone inside the lens' band
    drawn = np.sinc(np.minimum(np.hypot(down, across) * step_um, 0.6))
    seen = np.fft.rfft2(plane) * transfer * (pixel / drawn)
    return np.fft.irfft2(seen, s=(rows, columns))


@lru_cache(maxsize=6)
def _transfer(
    shape: tuple[int, int], step_um: float, view: ImagingView, defocus_um: float
) -> FloatArray | ComplexArray:
    """Return the transfer function on a tile's frequencies, from a tile large enough.

    The wave of a point is as periodic as its tile: it is taken from one on which it has
    faded, and its intensity then folded.
    """
    times = [max(1, math.ceil(LEAST_TILE_UM / (count * step_um))) for count in shape]
    wide = (shape[0] * times[0], shape[1] * times[1])
    spread = point_spread(wide, step_um, view, defocus_um)
    folded = spread.reshape(times[0], shape[0], times[1], shape[1]).sum(axis=(0, 2))
    transfer: ComplexArray = np.fft.rfft2(folded)
    return transfer if view.wavefront else transfer.real  # even where there is none


def between(image: FloatArray, column: FloatArray, row: FloatArray) -> FloatArray:
    """Return a band-limited image at any places, (...) in its columns and rows.

    A sinc under a Kaiser window: for images that a grid samples with room to spare.
    """
    across, left = _taps(column)
    down, top = _taps(row)
    rows, columns = image.shape
    total = np.zeros(column.shape)
    flat = image.ravel()
    for j in range(TAPS):
        line = np.clip(top + j, 0, rows - 1) * columns
        part = np.zeros(column.shape)
        for i in range(TAPS):
            part += across[i] * flat.take(line + np.clip(left + i, 0, columns - 1))
        total += down[j] * part
    return total


def _taps(at: FloatArray) -> tuple[list[FloatArray], IntArray]:
    """Return weights of the samples around places, and the first one's number."""
    first = np.floor(at).astype(np.intp) - TAPS // 2 + 1
    away = [at - first - k for k in range(TAPS)]
    half = TAPS / 2
    weights = [
        np.sinc(a) * np.i0(KAISER * np.sqrt(np.maximum(1 - (a / half) ** 2, 0)))
        for a in away
    ]
    total = np.sum(weights, axis=0)
    return [w / total for w in weights], first
