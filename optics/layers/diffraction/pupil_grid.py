"""Grid of directions of a pupil, with what carries a wave from height to height.

A wave is held as its spectrum of plane waves, by direction. Far from focus a chirp
turns that into the wave on the blurred pupil, near focus a transform into the wave by
place. Heights are in n wavelength / A**2, places in wavelength / A.

References
----------
Goodman (2005), Introduction to Fourier Optics, section 4.2; with the phase of the
marginal ray exact (`Microscope.rim_w20_um`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.transfer.microscope import Microscope

Wave = npt.NDArray[np.complex64]

# Directions go to 3 times the pupil's rim: what an edge in focus sends beyond is 3 % of
# the power there. Places are 1 / 6 apart, up to 16 aside.
SIDE = 192
_STEP = 1 / 32  # of directions, over the rim
# Above, a wave is held on the blurred pupil, whose fringes are two points wide or more;
# below, it fits between the places.
FAR = 12.0
_INSIDE = 8  # points aside in a cell of the pupil's rim


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveLevel:
    """A height at which a wave is held."""

    height: float  # above the plane in focus, n wavelength / A**2
    turn: Wave  # (SIDE, SIDE) phase: of places if far, of directions if near
    whole: Wave  # (SIDE, SIDE) wave of the whole pupil there
    power: Float32Array  # (SIDE, SIDE) of that, sums up to 1

    @property
    def is_far(self) -> bool:
        """Return whether waves are held on the blurred pupil."""
        return abs(self.height) > FAR

    @property
    def aside(self) -> FloatArray:
        """Return how far aside the points of waves are, (SIDE,) wavelength / A."""
        return self.height * directions() if self.is_far else places()


def carry(wave: Wave, start: WaveLevel, end: WaveLevel) -> Wave:
    """Return a wave (SIDE, SIDE) carried from one height to another one."""
    turned: Wave = start.turn.conj()
    if start.is_far and end.is_far:
        return _filtered(wave, turned * end.turn)
    if start.is_far:
        return _from_spectrum(_filtered(wave, turned), end.height, end.turn)
    spectrum: Wave = fft.fft2(wave, norm="ortho")
    return _from_spectrum(spectrum * turned, end.height, end.turn)


def _from_spectrum(spectrum: Wave, height: float, turn: Wave) -> Wave:
    """Return the wave at a height, (SIDE, SIDE)."""
    if abs(height) > FAR:
        return _filtered(spectrum, turn)
    found: Wave = fft.ifft2(spectrum * turn, norm="ortho")
    return found


def _filtered(wave: Wave, turn: Wave) -> Wave:
    """Return a wave whose transform is turned in phase, (SIDE, SIDE)."""
    transform: Wave = fft.fft2(wave)
    found: Wave = fft.ifft2(transform * turn)
    return found


def directions() -> FloatArray:
    """Return directions along one axis, zero first, (SIDE,) of the pupil's rim."""
    found: FloatArray = fft.fftfreq(SIDE, 1 / SIDE) * _STEP
    return found


def places() -> FloatArray:
    """Return places along one axis, zero first, (SIDE,) wavelength / A."""
    found: FloatArray = fft.fftfreq(SIDE, _STEP)
    return found


@lru_cache(maxsize=1)
def pupil() -> Float32Array:
    """Return the pupil's share of each direction's cell, (SIDE, SIDE), sums up to 1."""
    inner = ((np.arange(_INSIDE) + 0.5) / _INSIDE - 0.5) * _STEP
    u = (directions()[:, None] + inner).ravel()
    inside = u[:, None] ** 2 + u**2 <= 1
    cells = inside.reshape(SIDE, _INSIDE, SIDE, _INSIDE).mean(axis=(1, 3))
    return np.asarray(cells / cells.sum(), dtype=np.float32)


@lru_cache(maxsize=1)
def transfer() -> Float32Array:
    """Return the transfer function in focus by `pupil`, of `places`, (SIDE, SIDE)."""
    power = np.abs(fft.ifft2(np.sqrt(pupil()), norm="ortho")) ** 2
    return np.asarray(fft.fft2(power).real, dtype=np.float32)


@lru_cache(maxsize=16)
def level(height: float) -> WaveLevel:
    """Return a height, n wavelength / A**2 above the plane in focus."""
    is_far = abs(height) > FAR
    axis = places() if is_far else directions()
    square = axis[:, None] ** 2 + axis**2
    phase = square / height if is_far else -height * square
    turn = np.exp(1j * math.pi * phase).astype(np.complex64)
    whole = _from_spectrum(np.sqrt(pupil()).astype(np.complex64), height, turn)
    power = whole.real**2 + whole.imag**2
    return WaveLevel(height=height, turn=turn, whole=whole, power=power)


def height_of(microscope: Microscope, z_um: float) -> float:
    """Return a height, n wavelength / A**2, that has the exact phase at the rim."""
    return 2 * microscope.rim_w20_um(z_um) / microscope.wavelength_um
