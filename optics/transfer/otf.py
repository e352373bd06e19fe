"""Optical transfer functions of a circular pupil by defocus.

All are functions of x, the radial frequency over the cutoff 2 A / wavelength, and of
w, the defocus coefficient W20 in waves, or, where that is not enough, of the
defocus and the aperture. All are 1 at x = 0 and even in x and in the defocus.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from microplan.arrays import FloatArray
from microplan.optics.transfer.overlap import HighAperture, Paraxial, overlap


def diffraction(x: FloatArray) -> FloatArray:
    """Return the in-focus OTF of a circular pupil.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff, f wavelength / (2 A) [1].

    Returns
    -------
    (...) float64 array
        1 at 0, falling to 0 at 1 and beyond.

    Raises
    ------
    ValueError
        If `x` holds a nan.

    References
    ----------
    Feddema & Simon (1998), eq. (12), divided by its value at 0 (pi a**2).
    """
    s = np.minimum(_checked(x), 1.0)
    y = 4 * np.arcsin(np.sqrt((1 - s) / 2))  # 2 acos(s), exact where s is near 1
    tail = y**3 / 6 * (1 - y**2 / 20 * (1 - y**2 / 42 * (1 - y**2 / 72)))
    otf: FloatArray = (
        np.where(y < 0.1, tail, y - np.sin(y)) / np.pi
    )  # y - sin y cancels
    return otf


def geometric(x: FloatArray, w: float) -> FloatArray:
    """Return the OTF of a uniform blur circle, with no diffraction.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff [1]; not zero beyond 1.
    w : float
        W20 in waves; the circle's diameter is 4 w wavelength / A.

    Returns
    -------
    (...) float64 array
        jinc(8 pi w x), between -.133 and 1.

    Raises
    ------
    ValueError
        If an argument holds a nan.

    References
    ----------
    Feddema & Simon (1998), eqs. (8, 9), with volume 1.
    """
    return _jinc(8 * np.pi * _finite(w) * _checked(x))


def product(x: FloatArray, w: float) -> FloatArray:
    """Return the paper's OTF, `diffraction` times `geometric`.

    It counts diffraction twice and is up to .25 off near w = .35; kept to compare.
    Arguments, result and errors as in `geometric`; 0 beyond x = 1.

    References
    ----------
    Feddema & Simon (1998), section 3, eq. (8) times eq. (12).
    """
    return diffraction(x) * geometric(x, w)


def stokseth(x: FloatArray, w: float) -> FloatArray:
    """Return T(x) jinc(8 pi w x (1 - x)), a close approximation of `hopkins`.

    Arguments, result (...) [1] and errors as in `geometric`; 0 beyond x = 1.

    References
    ----------
    Stokseth (1969), J. Opt. Soc. Am. 59, 1314, without its empirical polynomial.
    """
    s = np.minimum(_checked(x), 1.0)
    return diffraction(s) * _jinc(8 * np.pi * _finite(w) * s * (1 - s))


def hopkins(x: FloatArray, w: float) -> FloatArray:
    """Return the OTF of a circular pupil with a quadratic defocus phase.

    ValueError if an argument holds a nan or `w` is infinite.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff [1].
    w : float
        W20 in waves; the time taken does not grow with it.

    Returns
    -------
    (...) float64 array
        1 at 0, 0 at 1 and beyond; `diffraction` where w = 0. Error below 1e-13.

    References
    ----------
    Hopkins (1955), Proc. R. Soc. Lond. A 231, 91: (4 / pi) times the integral over
    p in 0..acos x of sin(p)**2 cos(8 pi w x (cos p - x)).
    """
    s = np.minimum(_checked(x), 1.0).ravel()
    otf = overlap(Paraxial(), s, 8 * np.pi * abs(_finite(w)) * s)
    return otf.reshape(np.shape(x))


def exact(
    x: FloatArray,
    *,
    z_um: float,
    aperture: float,
    wavelength_um: float,
    index: float = 1.0,
) -> FloatArray:
    """Return the OTF of a uniform circular pupil with the exact defocus phase.

    The phase is 2 pi / wavelength z sqrt(n**2 - A**2 rho**2), rho = 0..1 over the
    pupil; `hopkins` is its limit for a small aperture.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff [1].
    z_um : float
        Defocus, of either sign.
    aperture : float
        Numerical aperture A, below `index`.
    wavelength_um : float
        In vacuum.
    index : float
        Of the medium n between object and lens.

    Returns
    -------
    (...) float64 array
        1 at 0, 0 at 1 and beyond; `diffraction` where z = 0. Error below 1e-13 up to
        A = .999 n; the time taken does not grow with z.

    Raises
    ------
    ValueError
        If an argument holds a nan or is infinite, or the aperture is not in (0, n).

    References
    ----------
    The axial transform of the three-dimensional OTF: Sheppard, Gu, Kawata & Kawata
    (1994), J. Opt. Soc. Am. A 11, 593. `microplan.optics.transfer.overlap` derives the
    single integral.
    """
    if not (0 < aperture < index and wavelength_um > 0 and math.isfinite(index)):
        raise ValueError(
            "need 0 < aperture < index and wavelength_um > 0, got "
            f"{aperture}, {index}, {wavelength_um}"
        )
    if z_um == 0:
        return diffraction(x)
    s = np.minimum(_checked(x), 1.0).ravel()
    pupils = HighAperture(aperture=aperture, index=index)
    otf = overlap(pupils, s, 2 * np.pi / wavelength_um * abs(_finite(z_um)) * s)
    return otf.reshape(np.shape(x))


def _jinc(q: FloatArray) -> FloatArray:
    """Return 2 J1(q) / q, by its series where q is small."""
    q = np.abs(q)
    small, large = np.minimum(q, 1e-3), np.maximum(q, 1e-3)
    value: FloatArray = np.where(q < 1e-3, 1 - small**2 / 8, 2 * j1(large) / large)
    return value


def _checked(x: FloatArray) -> FloatArray:
    """Return |x| as float64; a nan is refused."""
    values = np.abs(np.asarray(x, dtype=np.float64))
    if np.isnan(values).any():
        raise ValueError("x must not hold nan")
    return values


def _finite(w: float) -> float:
    """Return `w`; nan and infinity are refused."""
    if not math.isfinite(w):
        raise ValueError(f"w must be finite, got {w}")
    return w
