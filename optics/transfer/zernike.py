"""Zernike polynomials on the unit disc, in Noll's order and normalisation."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from microplan.arrays import FloatArray

LEAST, MOST = 1, 22  # Noll indices: to spherical aberration of the sixth order
_NODES = np.cos(np.pi * (np.arange(7) + 0.5) / 7)  # as many as powers of one axis


def zernike(noll: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a polynomial whose mean square over the unit disc is 1.

    Parameters
    ----------
    noll : int
        1..22. Even ones go with the cosine of the angle from x, odd ones with its sine:
        7 is coma along y, 8 along x, 11 spherical aberration.
    x, y : (...) float arrays
        Points over the disc's radius; beyond it the polynomial goes on.

    Returns
    -------
    (...) float64 array
        Waves for each wave rms.

    Raises
    ------
    ValueError
        If the index is out of range.

    References
    ----------
    Noll (1976), J. Opt. Soc. Am. 66, 207, eqs. (1) to (3).
    """
    if not LEAST <= noll <= MOST:
        raise ValueError(f"noll must be in {LEAST}..{MOST}, got {noll}")
    n, m = _orders(noll)
    radius = np.hypot(x, y)
    found = np.zeros(np.shape(radius))
    for k in range((n - m) // 2 + 1):
        below = (
            math.factorial(k)
            * math.factorial((n + m) // 2 - k)
            * math.factorial((n - m) // 2 - k)
        )
        found += (-1) ** k * math.factorial(n - k) / below * radius ** (n - 2 * k)
    if m == 0:
        return np.asarray(math.sqrt(n + 1) * found)
    angle = m * np.arctan2(y, x)
    turn = np.cos(angle) if noll % 2 == 0 else np.sin(angle)
    return np.asarray(math.sqrt(2 * (n + 1)) * found * turn)


def terms_on_grid(
    terms: Iterable[tuple[int, float]], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return a sum of terms on the points of a grid.

    Parameters
    ----------
    terms : iterable of (int, float)
        Noll's index, waves rms.
    x, y : (J,), (K,) float arrays
        Columns and rows over the disc's radius.

    Returns
    -------
    (K, J) float64 array
        Waves: the polynomial of sixth degree through 7 x 7 points, which is the sum.
    """
    values = np.zeros((_NODES.size, _NODES.size))
    for noll, waves in terms:
        values += waves * zernike(noll, _NODES[None, :], _NODES[:, None])
    along, up = (_weights(points) for points in (x, y))
    return np.asarray(up @ values @ along.T)


def _weights(points: FloatArray) -> FloatArray:
    """Return the weights of values at `_NODES` in polynomials at points, (N, 7)."""
    powers = np.vander(_NODES, increasing=True)
    found = np.linalg.solve(powers.T, np.vander(points, _NODES.size, increasing=True).T)
    return np.asarray(found.T)


def turns_of(noll: int) -> int:
    """Return how often a term repeats in a turn: odd ones differ side from side."""
    return _orders(noll)[1]


def _orders(noll: int) -> tuple[int, int]:
    """Return the order n of the radius and m >= 0 of the angle."""
    n = (math.isqrt(8 * noll - 7) - 1) // 2
    rest = noll - n * (n + 1) // 2 - 1  # 0..n within the order
    return n, 2 * ((rest + 1 + n % 2) // 2) - n % 2
