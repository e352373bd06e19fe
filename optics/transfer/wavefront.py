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
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.zernike import zernike

# Cells over the pupil's radius, and cycles of defocus phase a cell at its rim: changes
# are within 2 % of the overlap's integral, places of edges within 1 % (tested).
_CELLS, _MOST_CELLS, _RATE = 24, 96, 0.16
_RIM = 4  # points a side of a cell on the rim
_DIRECTIONS = 12  # of edges round a disc: of three- and fourfold terms none is left
_FREQUENCIES = 96  # at which an edge's profile is summed
# Wavelengths over A: how far the middle of a pupil's error of .25 waves rms may tilt,
# how close edges are looked at, and what Newton's last step is where it has settled.
_FAR, _APART, _SETTLED = 6.0, 0.05, 1e-4


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
    u_per_um, v_per_um : (J,), (K,) float arrays
        Frequencies along x and along y (up), cycles/um.

    Returns
    -------
    (K, J) complex128 array
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
    cubics = _changes(microscope.without_pixels, z_um, cells)
    step_per_um = microscope.cutoff_per_um / (2 * cells)
    along, up = (_weights(f / step_per_um, cells) for f in (u_per_um, v_per_um))
    return np.asarray(up @ cubics @ along.T)


def most_defocus_um(microscope: Microscope) -> float:
    """Return the defocus beyond which no change is computed, um."""
    return _MOST_CELLS * _RATE / _rim_rate(microscope)


def disc_shift_um(microscope: Microscope) -> tuple[float, float]:
    """Return where the lens shows the middle of a large disc in focus, (x, y) um.

    Its edges are straight to the lens: each moves along its normal, and their middle is
    the mean over all directions. Coma alone moves it. What blurs more, as defocus or
    larger pixels do, moves otherwise, at last by the centroid of a point's image: the
    pixels are those of `disc_side_um`, the camera's also where samples are finer.
    """
    if not microscope.wavefront:
        return 0.0, 0.0
    x = y = 0.0
    places = edge_places_um(microscope).tolist()
    for angle, off in zip(edge_angles_rad(), places, strict=True):
        x += 2 * math.cos(angle) * off / _DIRECTIONS
        y += 2 * math.sin(angle) * off / _DIRECTIONS
    return x, y


def edge_places_um(microscope: Microscope) -> FloatArray:
    """Return where edges in focus, at 0, are half way up, um along their normals, (D,).

    Normals have the angles of `edge_angles_rad`; pixels are those of `disc_shift_um`.
    """
    lens, side = microscope, microscope.shown_side_um
    f = lens.cutoff_per_um * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
    found = []
    for angle, line in zip(edge_angles_rad(), _lines(lens.without_pixels), strict=True):
        c, s = math.cos(angle), math.sin(angle)
        pixel = np.sinc(f * c * side) * np.sinc(f * s * side)
        found.append(_edge_um(f, line * pixel))
    return np.array(found)


def edge_angles_rad() -> list[float]:
    """Return directions all round a disc, from x towards y."""
    return [2 * math.pi * k / _DIRECTIONS for k in range(_DIRECTIONS)]


@lru_cache(maxsize=16)
def _lines(lens: Microscope) -> tuple[ComplexArray, ...]:
    """Return the OTF in focus along lines from frequency 0, (_FREQUENCIES,) each."""
    cubics = _cubics(_overlap(lens, 0.0, _CELLS))
    shifts = 2 * _CELLS * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES  # in cells
    found = []
    for angle in edge_angles_rad():
        along, up = (
            _weights(shifts * part, _CELLS)
            for part in (math.cos(angle), math.sin(angle))
        )
        found.append(((up @ cubics) * along).sum(axis=1))
    return tuple(found)


def _edge_um(f: FloatArray, transfer: ComplexArray) -> float:
    """Return where an edge's image is half its step, um, by Newton's method.

    1/2 + sum of Im(T exp(2 pi i f x)) / f / pi df is the image of a step at 0. Where it
    has fringes, the place is that of its steepest rise.
    """
    airy_um = 2 / float(f[-1])  # but for half a step
    x, step = _halfway_um(f, transfer, 0.0)
    if abs(step) > _SETTLED * airy_um or abs(x) > _FAR * airy_um:
        places = np.arange(-_FAR, _FAR, _APART) * airy_um
        waves = np.exp(2j * np.pi * np.outer(places, f))
        level, slope = (waves @ (transfer / f)).imag, (waves @ transfer).real
        rises = np.flatnonzero((level[:-1] <= 0) & (level[1:] > 0))
        if rises.size:
            steepest = rises[np.argmax(slope[rises])]
            x, _ = _halfway_um(f, transfer, float(places[steepest]))
    return x


def _halfway_um(f: FloatArray, transfer: ComplexArray, x: float) -> tuple[float, float]:
    """Return the place and the last step of Newton's method from a place on, um."""
    step = 0.0
    for _ in range(4):
        waves = transfer * np.exp(2j * np.pi * f * x)
        step = float((waves.imag / f).sum() / (2 * np.pi * waves.real.sum()))
        x -= step
    return x, step


def _weights(shifts: FloatArray, cells: int) -> FloatArray:
    """Return the weights of cubics' coefficients at shifts, (N, 4 cells + 1).

    The cubic B-spline: Unser (1999), IEEE Signal Processing Magazine 16 (6), 22, eq. 2.
    """
    d = np.abs(shifts[:, None] - np.arange(-2 * cells, 2 * cells + 1))
    near, far = 2 / 3 - d**2 + d**3 / 2, np.maximum(2 - d, 0) ** 3 / 6
    return np.where(d < 1, near, far)


def _cells(microscope: Microscope, z_um: float) -> int:
    """Return how many cells the pupil's radius has."""
    rate = abs(z_um) * _rim_rate(microscope)
    return min(max(_CELLS, math.ceil(rate / _RATE)), _MOST_CELLS)


def _rim_rate(microscope: Microscope) -> float:
    """Return cycles of phase a pupil's radius at its rim, for each um of defocus."""
    n, A = microscope.medium_index, microscope.aperture
    return A / math.sqrt(n**2 - A**2) * A / microscope.wavelength_um


@lru_cache(maxsize=64)  # .15 MB each near focus; layers and zooms share them
def _changes(lens: Microscope, z_um: float, cells: int) -> ComplexArray:
    """Return cubics' coefficients of the OTF's change at shifts of whole cells."""
    plain = replace(lens, wavefront=())
    return _cubics(_overlap(lens, z_um, cells) - _overlap(plain, z_um, cells))


def _cubics(values: ComplexArray) -> ComplexArray:
    """Return the coefficients of the cubics through samples, same shape."""
    found: ComplexArray = ndimage.spline_filter(values, output=np.complex128)
    found.setflags(write=False)
    return found


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


@lru_cache(maxsize=32)
def _disc(cells: int, radius: float) -> FloatArray:
    """Return the share of each cell inside a circle over the pupil's radius."""
    fine = (np.arange(_RIM * (2 * cells + 1)) + 0.5) / _RIM - cells - 0.5
    inside = fine[None, :] ** 2 + fine[:, None] ** 2 <= (radius * cells) ** 2
    size = 2 * cells + 1
    shares: FloatArray = inside.reshape(size, _RIM, size, _RIM).mean(axis=(1, 3))
    shares.setflags(write=False)
    return shares
