"""The exact defocus phase by a two-dimensional quadrature: slow, for tests only."""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope


def exact_otf(x: FloatArray, optics: Microscope, z_um: float) -> FloatArray:
    """Return the OTF of a uniform pupil whose phase is k z sqrt(n**2 - A**2 rho**2).

    Parameters
    ----------
    x : (N,) float array
        Radial frequency over the cutoff, 0..1.
    optics : Microscope
        The optical setting.
    z_um : float
        Defocus.

    Returns
    -------
    (N,) float64 array
        1 at 0.

    References
    ----------
    Sheppard & Larkin (1994), Optik 95, 127, with a uniform pupil.
    """
    A, n, lam = optics.aperture, optics.medium_index, optics.wavelength_um
    count = int(48 + 3 * abs(z_um) * A**2 / lam)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    turn, share = np.polynomial.legendre.leggauss(max(32, count // 2))
    u, turns = (1 + turn) * np.pi / 4, share * np.pi / 4
    result = np.empty(len(x))
    for i, shift in enumerate(x):
        rim = np.arccos(min(shift, 1.0))
        p = rim * (1 + nodes[:, None]) / 2
        xi, eta = np.cos(p) - shift, np.sin(p) * np.sin(u)
        right = np.sqrt(n**2 - A**2 * ((xi + shift) ** 2 + eta**2))
        left = np.sqrt(n**2 - A**2 * ((xi - shift) ** 2 + eta**2))
        path = -4 * A**2 * xi * shift / (right + left)  # right - left, uncancelled
        wave = np.cos(2 * np.pi / lam * z_um * path) * np.sin(p) ** 2 * np.cos(u)
        result[i] = 2 / np.pi * rim * (weights @ wave @ turns)
    return result
