"""Smooth curves on even nodes, computed at every other one alone.

What lies between is read from polynomials through its neighbours, and so are slopes.
Cubics through both err by as little as a cubic spline, at its ends by less.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from microplan.arrays import FloatArray

_POINTS = 12  # of the polynomial through computed values
_EXACT = _POINTS - 2  # nodes at either end that are all computed: the next has 6 aside
_SLOPES = 9  # points of a slope
_LEAST = 2 * _EXACT + _POINTS  # nodes below which all are computed


def refined(
    curve: Callable[[FloatArray], FloatArray], first: float, last: float, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return a smooth curve and its slope on even nodes.

    Parameters
    ----------
    curve : callable
        Values (N,) [1] at positions (N,).
    first, last : float
        The outermost nodes.
    count : int
        Nodes, an odd number, at least 9. Waves of h rad a node are followed within
        5.5e-5 (2 h)**12 of their height; the error of their slopes, over the steepest,
        is h**8 / 630 and what differences make of that, at the ends h**8 / 9 (tested).

    Returns
    -------
    values, slopes : (N,) float64 arrays, N = count
    """
    if count % 2 == 0 or count < _SLOPES:
        raise ValueError(f"count must be odd and at least {_SLOPES}, got {count}")
    nodes = np.linspace(first, last, count)
    computed = np.zeros(count, dtype=bool)
    computed[::2] = True
    computed[:_EXACT] = computed[-_EXACT:] = True
    if count < _LEAST:
        computed[:] = True
    values = np.empty(count)
    values[computed] = curve(nodes[computed])
    if count >= _LEAST:
        about = np.lib.stride_tricks.sliding_window_view(values[::2], _POINTS)
        values[_POINTS - 1 : -_POINTS + 1 : 2] = about @ _BETWEEN
    return values, _slopes(values) * ((count - 1) / (last - first))


def _slopes(values: FloatArray) -> FloatArray:
    """Return slopes a step, (N,)."""
    slopes, half = np.empty(values.size), _SLOPES // 2
    about = np.lib.stride_tricks.sliding_window_view(values, _SLOPES)
    slopes[half:-half] = about @ _AT_NODE[half]
    slopes[:half] = _AT_NODE[:half] @ values[:_SLOPES]
    slopes[-half:] = _AT_NODE[half + 1 :] @ values[-_SLOPES:]
    return slopes


def _middle_weights() -> FloatArray:
    """Return the weights (points,) of a polynomial's value amid its nodes."""
    place = np.arange(_POINTS, dtype=np.float64) - (_POINTS - 1) / 2
    apart = place[:, None] - place
    np.fill_diagonal(apart, 1.0)
    others = np.where(np.eye(_POINTS, dtype=bool), 1.0, -place)
    return np.asarray(np.prod(others / apart, axis=1), dtype=np.float64)


def _slope_weights() -> FloatArray:
    """Return the weights of a polynomial's slope at each of its nodes, (at, points).

    References
    ----------
    Berrut & Trefethen (2004), SIAM Review 46, 501, section 9.
    """
    place = np.arange(_SLOPES, dtype=np.float64)
    apart = place[:, None] - place
    np.fill_diagonal(apart, 1.0)
    bary = 1 / np.prod(apart, axis=1)
    slope = bary / bary[:, None] / apart
    np.fill_diagonal(slope, 0.0)
    np.fill_diagonal(slope, -slope.sum(axis=1))
    return np.asarray(slope, dtype=np.float64)


_BETWEEN = _middle_weights()
_AT_NODE = _slope_weights()
