"""OTF where a lamp from below fills only the middle of the pupil.

Rays beyond the lamp's aperture are dark: defocus blurs by the lamp's cone, and the lens
resolves what the whole pupil lets through of it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from microplan.arrays import FloatArray

# Beyond so many rad of phase from the lamp's middle to its rim the transfer is below
# .004, and that of rays alone serves.
_RAYS_ALONE = 60.0
_NODES, _A_RAD = 24, 0.5  # Gauss nodes along an axis, and more for each rad of phase
_AT_ONCE = 1 << 21  # phases evaluated together


def lamp_limited(
    x: FloatArray,
    *,
    z_um: float,
    aperture: float,
    lamp_aperture: float,
    wavelength_um: float,
    index: float = 1.0,
) -> FloatArray:
    """Return the transfer of a weak object's absorption under a narrow lamp.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over 2 A / wavelength [1].
    z_um : float
        Defocus, of either sign.
    aperture, lamp_aperture : float
        Of the objective, A, and of the lamp, A_l <= A < `index`.
    wavelength_um, index : float
        In vacuum; of the medium n between object and lens.

    Returns
    -------
    (...) float64 array
        1 at 0, 0 from x = (1 + s) / 2 on with s = A_l / A. For s = 1 that of
        `microplan.optics.transfer.otf.exact`; far from focus that of rays within the
        lamp's cone, within .006.

    Raises
    ------
    ValueError
        If the apertures are not in order or an argument is not finite.

    References
    ----------
    Hopkins (1953), Proc. R. Soc. A 217, 408: the transmission cross-coefficient C(f,
    0), its real part, over C(0, 0). Strong edges move against it by up to .11
    wavelength / A, which is charged as partial coherence.
    """
    if not (0 < lamp_aperture <= aperture < index and wavelength_um > 0):
        raise ValueError(
            "need 0 < lamp_aperture <= aperture < index and wavelength_um > 0, got "
            f"{lamp_aperture}, {aperture}, {index}, {wavelength_um}"
        )
    values = np.abs(np.asarray(x, dtype=np.float64))
    if not (np.isfinite(values).all() and math.isfinite(z_um)):
        raise ValueError("x and z_um must be finite")
    s = lamp_aperture / aperture
    radius_um = abs(z_um) * lamp_aperture / math.sqrt(index**2 - lamp_aperture**2)
    phase = 2 * math.pi * radius_um * values.ravel() * 2 * aperture / wavelength_um
    found = np.zeros(values.size)
    inside = values.ravel() < (1 + s) / 2
    far = inside & (phase > _RAYS_ALONE)
    found[far] = 2 * j1(phase[far]) / phase[far]
    wave = 2 * math.pi / wavelength_um * abs(z_um)
    near = np.flatnonzero(inside & ~far)
    near = near[np.argsort(phase[near], kind="stable")]
    start = 0
    while start < near.size:
        count = _NODES + math.ceil(_A_RAD * float(phase[near[start]]))
        stop = start + max(1, _AT_ONCE // (2 * count * count))
        some = near[start:stop]
        count = _NODES + math.ceil(_A_RAD * float(phase[some].max()))
        found[some] = _overlap(values.ravel()[some], s, aperture, index, wave, count)
        start = stop
    return found.reshape(values.shape)


def _overlap(
    x: FloatArray, s: float, aperture: float, index: float, wave: float, count: int
) -> FloatArray:
    """Return the integral over the lamp's disc within the displaced pupil, (N,).

    The disc's left part ends at its own rim, its right part at the pupil's.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    safe = np.maximum(x, 1e-12)
    right = np.minimum(s, 1 - 2 * x)
    split = np.clip((1 - s * s - 4 * x * x) / (4 * safe), -s, right)
    total = np.zeros(x.size)
    for low, high in ((np.full(x.size, -s), split), (split, right)):
        # across by a sine: rims rise as square roots at both ends
        t = np.sin(nodes * math.pi / 2)
        u = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * t
        step = (high - low)[:, None] / 2 * weights * np.cos(nodes * math.pi / 2)
        lamp = np.maximum(s * s - u * u, 0.0)
        pupil = np.maximum(1 - (u + 2 * x[:, None]) ** 2, 0.0)
        top = np.sqrt(np.minimum(lamp, pupil))
        v2 = (top[:, :, None] * (nodes + 1) / 2) ** 2
        one = u[:, :, None] ** 2 + v2
        other = (u + 2 * x[:, None])[:, :, None] ** 2 + v2
        delay = _height(other, aperture, index) - _height(one, aperture, index)
        inner = np.cos(wave * delay) @ (weights / 2)
        total += math.pi * (step * top * inner).sum(axis=1)
    found: FloatArray = total / (math.pi * s * s)
    return found


def _height(r2: FloatArray, aperture: float, index: float) -> FloatArray:
    """Return the axial component of a wave at a squared radius in the pupil [1]."""
    found: FloatArray = np.sqrt(np.maximum(index**2 - aperture**2 * r2, 0.0))
    return found
