"""What a wavefront error adds to how far edges move in partly coherent light."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from microplan.arrays import ComplexArray, FloatArray
from microplan.optics.coherence.coherence import lit_disc_shift_um
from microplan.optics.coherence.source import disc_source
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.wavefront import edge_angles_rad, edge_places_um
from microplan.optics.transfer.zernike import zernike

_PERIOD = 40.0  # wavelength / A, of bright bars half as wide
_SAMPLES = 6  # of the source; what it errs by is the perfect lens' as well
_REACH, _STEP = 0.6, 0.02  # wavelength / A about an edge, where it is looked for


def aberrated_offsets_um(
    coherence: float, microscope: Microscope, contrast: float
) -> FloatArray:
    """Return what the lens' wavefront error adds to the offsets of edges in focus.

    Parameters
    ----------
    coherence : float
        Condenser over objective aperture, > 0.
    contrast : float
        Of the amplitudes, see
        `microplan.optics.coherence.edge_offsets.amplitude_contrast`.

    Returns
    -------
    (D,) float64 array
        um into the bright side, of edges all round a disc: on top of the offset through
        a perfect lens, and of where incoherent light shows them through this one. Both
        images are counted from where they show the disc's middle; what is left differs
        by direction. 0 without a wavefront error or a contrast. Within .002 wavelength
        / A of `microplan.optics.coherence.coherence.render_coherent` (tested); pixels
        are points.
    """
    angles = np.array(edge_angles_rad())
    if not microscope.wavefront or contrast == 0:
        return np.zeros(angles.size)
    lens = replace(microscope.without_pixels, lamp_aperture=None, fill_factor=1e-12)
    return _added_um(coherence, lens, contrast)


@lru_cache(maxsize=256)
def _added_um(coherence: float, lens: Microscope, contrast: float) -> FloatArray:
    """Return the same, not to be changed; points of an interval are asked for again."""
    angles = np.array(edge_angles_rad())

    def along(shift_um: tuple[float, float]) -> FloatArray:
        return np.asarray(shift_um[0] * np.cos(angles) + shift_um[1] * np.sin(angles))

    moved = along(lit_disc_shift_um(lens, coherence))
    usual = edge_places_um(lens) - along(lit_disc_shift_um(lens, 1.0))
    airy_um = lens.wavelength_um / lens.aperture
    plain = replace(lens, wavefront=())
    perfect = _place(coherence, plain, contrast, 0.0, 0.0)
    found = np.array(
        [
            _place(coherence, lens, contrast, angle, off / airy_um) - perfect
            for angle, off in zip(angles.tolist(), moved.tolist(), strict=True)
        ]
    )
    found = found * airy_um - usual
    found.setflags(write=False)
    return found


def _place(
    coherence: float, lens: Microscope, contrast: float, angle: float, about: float
) -> float:
    """Return where an edge is half way up less `about`, wavelength / A.

    `angle` is that of the normal into the bright side.
    """
    x = np.arange(-_REACH, _REACH, _STEP)
    j = np.arange(-2 * _PERIOD, 2 * _PERIOD + 1)
    odd = np.where(j % 2 == 0, 1.0, j)
    bar = np.where(j % 2 == 0, 0.5 * (j == 0), 1 / (1j * np.pi * odd))
    field = contrast * bar + (1 - contrast) * (j == 0)
    f = j / _PERIOD
    source = disc_source(coherence, _SAMPLES)
    pupil = _pupil(lens, f + source.x[:, None], source.y[:, None], angle)
    waves = np.exp(2j * np.pi * np.outer(f, x + about))
    light = source.weight @ np.abs((pupil * field) @ waves) ** 2
    line = CubicSpline(x, light - (1 + (1 - contrast) ** 2) / 2)
    roots = line.roots(extrapolate=False)
    if not roots.size:  # it is farther off
        return math.copysign(_REACH, -float(line(0.0)))
    return float(roots[np.argmax(line(roots, 1))])


def _pupil(
    lens: Microscope, p: FloatArray, q: FloatArray, angle: float
) -> ComplexArray:
    """Return the pupil at points along and across a normal, (S, F) and (S, 1)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = c * p - s * q, s * p + c * q
    waves = np.zeros(p.shape)
    for noll, rms in lens.wavefront:
        waves += rms * zernike(noll, x, y)
    return np.asarray((p**2 + q**2 <= 1) * np.exp(2j * np.pi * waves))
