"""A wave calculation of a straight edge seen past another: the judge of occlusion.

Scalar and paraxial, for edges along y and a circular pupil. The back is a plane of
incoherent points. The field of each is carried to the front plane, masked there,
carried to the plane in focus and limited by the pupil; intensities are added. The
points send in all directions that the grid holds, so that nothing is coherent in
contact: what is left of coherence comes from the distance of the two planes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import fft

from microplan.arrays import FloatArray

_BATCH = 256  # points carried at once
_SLICES = 6  # Gauss nodes over the half pupil across the edges


def places(count: int, step: float) -> FloatArray:
    """Return the middles of cells around 0, (count,), wavelength / A."""
    cells = np.arange(count, dtype=np.float64)
    return (cells - count // 2 + 0.5) * step


def behind_a_mask(
    x: FloatArray, back: FloatArray, mask: FloatArray, front_z: float, back_z: float
) -> FloatArray:
    """Return the image of a back plane behind a mask.

    Parameters
    ----------
    x : (N,) float array
        From `places`; the period is N cells.
    back : (N,) float array
        Intensity the back sends.
    mask : (N,) float array
        What the front lets pass, 0 or 1.
    front_z, back_z : float
        Heights above the plane in focus, n wavelength / A**2.

    Returns
    -------
    (N,) float64 array
        1 for a uniform back without a mask.
    """
    sending = np.flatnonzero(back)
    image: FloatArray = back[sending] @ points(x, sending, mask, front_z, back_z)
    return image


def points(
    x: FloatArray,
    sending: npt.NDArray[np.intp],
    mask: FloatArray,
    front_z: float,
    back_z: float,
) -> FloatArray:
    """Return the images (S, N) of points of the back plane, by their index in `x`.

    Waves are in single precision; see `behind_a_mask` for the rest.

    References
    ----------
    Fresnel propagation: Goodman (2005), Introduction to Fourier Optics, section 4.2.
    """
    f = fft.fftfreq(x.size, x[1] - x[0])  # cycles per wavelength / A; the rim is at 1
    nodes, weights = np.polynomial.legendre.leggauss(2 * _SLICES)
    one = fft.ifft(np.exp(-1j * np.pi * (front_z - back_z) * f**2))  # from x[0]
    waves = np.array([np.roll(one, s) for s in sending], dtype=np.complex64)
    waves = fft.fft(waves * mask.astype(np.float32), axis=1)
    image, whole = np.zeros((sending.size, x.size)), 0.0
    for q, weight in zip(nodes[_SLICES:], weights[_SLICES:], strict=True):
        # a slice of the pupil; its ends count by the share of the frequency's cell
        passed = np.clip((np.sqrt(1 - q**2) - np.abs(f)) / f[1] + 0.5, 0, 1)
        pupil = np.sqrt(passed) * np.exp(1j * np.pi * front_z * f**2)
        pupil = pupil.astype(np.complex64)
        whole += weight * float(passed.sum()) / x.size
        for start in range(0, sending.size, _BATCH):
            part = slice(start, start + _BATCH)
            image[part] += weight * np.abs(fft.ifft(waves[part] * pupil, axis=1)) ** 2
    found: FloatArray = image / whole
    return found
