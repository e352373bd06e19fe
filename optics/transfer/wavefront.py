"""What a wavefront error of the lens changes of its OTF, by the pupil's overlap.

Sampled, not in closed form: changes are right within 2 percent of themselves, which
is enough for what moves answers by some nm. A pupil sampled alike without the error is
taken off, so that what sampling itself errs by has no part in them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy import fft, ndimage

from microplan.arrays import ComplexArray, FloatArray
from microplan.optics.transfer.microscope import Microscope, Terms
from microplan.optics.transfer.zernike import zernike

# Cells over the pupil's radius, and cycles of defocus phase a cell at its rim. With
# them the change of an edge's place is within 2 % of that of four times as many
# (tested).
_CELLS, _MOST_CELLS, _RATE = 24, 96, 0.16
_RIM = 4  # points a side of a cell on the rim
Sampled = tuple[FloatArray, FloatArray]  # real, imaginary; (4 cells + 1, 4 cells + 1)
_DIRECTIONS = 12  # of edges round a disc: of three- and fourfold terms none is left
_FREQUENCIES = 96  # at which an edge's profile is summed


def transfer_change(
    microscope: Microscope, z_um: float, u_per_um: FloatArray, v_per_um: FloatArray
) -> ComplexArray:
    """Return the OTF with the microscope's wavefront error less that without.

    Parameters
    ----------
    microscope : Microscope
        With its `wavefront`.
    z_um : float
        Height of the object minus that of the plane in focus, with its sign; up to
        `most_defocus_um` either way, ValueError beyond.
    u_per_um, v_per_um : float arrays that broadcast together, one axis at least
        Frequencies along x and y (up), cycles/um.

    Returns
    -------
    (...) complex128 array
        0 at frequency 0 and from the cutoff on; conjugate at the opposite frequency.

    Notes
    -----
    The phase of the pupil is 2 pi W, W = z (n / lambda - s) + the terms' sum, with s
    the wave's component along the axis, sqrt((n / lambda)**2 - f**2): the exact one,
    and the signs those of a body's field carried to the plane in focus.

    References
    ----------
    Goodman, Introduction to Fourier Optics (2005), eqs. (6-28) and (6-33); under a
    narrow lamp the transfer of a weak object, as in
    `microplan.optics.transfer.lamp_limited`.
    """
    if not abs(z_um) <= most_defocus_um(microscope):
        raise ValueError(
            f"z_um must be within {most_defocus_um(microscope):.3g}, got {z_um}"
        )
    cells = _cells(microscope, z_um)
    found = _changes(_eyeless(microscope), z_um, cells)
    return _between(found, microscope.cutoff_per_um / (2 * cells), u_per_um, v_per_um)


def most_defocus_um(microscope: Microscope) -> float:
    """Return the defocus beyond which no change is computed, um."""
    return _MOST_CELLS * _RATE / _rim_rate(microscope)


def disc_shift_um(microscope: Microscope) -> tuple[float, float]:
    """Return where the lens shows the middle of a large disc in focus, (x, y) um.

    Its edges are straight to the lens: each moves along its normal, and their middle is
    the mean over all directions. Coma alone moves it. What blurs more, as defocus or
    larger pixels do, moves otherwise, at last by the centroid of a point's image.
    """
    return _disc_shift_um(
        microscope.wavefront,
        replace(microscope, wavefront=(), width_px=1, height_px=1),
    )


@lru_cache(maxsize=256)
def _disc_shift_um(terms: Terms, optics: Microscope) -> tuple[float, float]:
    if not terms:
        return 0.0, 0.0
    lens = replace(optics, wavefront=terms)
    samples = _cubics(_overlap(_eyeless(lens), 0.0, _CELLS))
    step_per_um = lens.cutoff_per_um / (2 * _CELLS)
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    f = lens.cutoff_per_um * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
    side = lens.um_per_px * math.sqrt(lens.fill_factor)
    x = y = 0.0
    for angle in angles.tolist():
        c, s = math.cos(angle), math.sin(angle)
        pixel = np.sinc(f * c * side) * np.sinc(f * s * side)
        off = _edge_um(f, _between(samples, step_per_um, f * c, f * s) * pixel)
        x, y = x + 2 * c * off / _DIRECTIONS, y + 2 * s * off / _DIRECTIONS
    return x, y


def _edge_um(f: FloatArray, transfer: ComplexArray) -> float:
    """Return where an edge's image is half its step, um, by Newton's method.

    1/2 + sum of Im(T exp(2 pi i f x)) / f / pi df is the image of a step at 0.
    """
    x = 0.0
    for _ in range(4):
        waves = transfer * np.exp(2j * np.pi * f * x)
        x -= float((waves.imag / f).sum() / (2 * np.pi * waves.real.sum()))
    return x


def _between(
    samples: Sampled, step_per_um: float, u_per_um: FloatArray, v_per_um: FloatArray
) -> ComplexArray:
    """Return a sampled function at frequencies, by cubics; 0 beyond its samples."""
    u, v = np.broadcast_arrays(u_per_um / step_per_um, v_per_um / step_per_um)
    at = np.stack([v, u]) + (samples[0].shape[0] - 1) / 2
    real, imag = (
        ndimage.map_coordinates(part, at, order=3, prefilter=False) for part in samples
    )
    return np.asarray(real + 1j * imag)


def _eyeless(microscope: Microscope) -> Microscope:
    """Return the lens alone: what depends on no pixel is shared by all zooms."""
    return replace(
        microscope,
        magnification=1.0,
        pitch_um=1.0,
        width_px=1,
        height_px=1,
        fill_factor=1.0,
        halo=None,
    )


def _cells(microscope: Microscope, z_um: float) -> int:
    """Return how many cells the pupil's radius has."""
    rate = abs(z_um) * _rim_rate(microscope)
    return min(max(_CELLS, math.ceil(rate / _RATE)), _MOST_CELLS)


def _rim_rate(microscope: Microscope) -> float:
    """Return cycles of phase a pupil's radius at its rim, for each um of defocus."""
    n, A = microscope.medium_index, microscope.aperture
    return A / math.sqrt(n**2 - A**2) * A / microscope.wavelength_um


@lru_cache(maxsize=64)  # .15 MB each near focus; layers and zooms share them
def _changes(lens: Microscope, z_um: float, cells: int) -> Sampled:
    """Return cubics' coefficients of the OTF's change at shifts of whole cells."""
    plain = replace(lens, wavefront=())
    return _cubics(_overlap(lens, z_um, cells) - _overlap(plain, z_um, cells))


def _cubics(values: ComplexArray) -> Sampled:
    """Return cubics' coefficients of real and imaginary part, same shapes."""
    real, imag = (ndimage.spline_filter(part) for part in (values.real, values.imag))
    for part in (real, imag):
        part.setflags(write=False)
    return real, imag


def _overlap(lens: Microscope, z_um: float, cells: int) -> ComplexArray:
    """Return the OTF at shifts by whole cells, v upwards and u along.

    (4 cells + 1, 4 cells + 1), 0 in the middle.
    """
    size = fft.next_fast_len(4 * cells + 2)
    waves = _waves(lens, z_um, cells)
    whole, lamp = _disc(cells, 1.0), _disc(cells, lens.cone_aperture / lens.aperture)
    seen, sent = (fft.fft2(part * waves, (size, size)) for part in (whole, lamp))
    # the mean of C(f, 0) and C(0, -f): what a real object's waves interfere by
    both = fft.ifft2((seen * sent.conj()).real) / lamp.sum()
    both = np.roll(both, (2 * cells, 2 * cells), axis=(0, 1))
    return np.asarray(both[: 4 * cells + 1, : 4 * cells + 1])


def _waves(lens: Microscope, z_um: float, cells: int) -> ComplexArray:
    """Return the field's phase factors, (2 cells + 1, 2 cells + 1)."""
    axis = np.arange(-cells, cells + 1) / cells
    x, y = np.broadcast_arrays(axis[None, :], axis[:, None])
    across = lens.medium_index / lens.wavelength_um
    f2 = (x**2 + y**2) * (lens.aperture / lens.wavelength_um) ** 2
    waves = z_um * (across - np.sqrt(np.maximum(across**2 - f2, 0)))
    for noll, rms in lens.wavefront:
        waves = waves + rms * zernike(noll, x, y)
    return np.asarray(np.exp(2j * np.pi * waves))


def _disc(cells: int, radius: float) -> FloatArray:
    """Return the share of each cell inside a circle over the pupil's radius."""
    fine = (np.arange(_RIM * (2 * cells + 1)) + 0.5) / _RIM - cells - 0.5
    inside = fine[None, :] ** 2 + fine[:, None] ** 2 <= (radius * cells) ** 2
    size = 2 * cells + 1
    shares: FloatArray = inside.reshape(size, _RIM, size, _RIM).mean(axis=(1, 3))
    return shares
