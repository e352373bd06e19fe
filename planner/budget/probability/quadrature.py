"""Gauss quadrature over pieces whose ends are known."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from microplan.arrays import FloatArray


def nodes_between(cuts: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights, (..., (K-1) count), of cuts' unit, (..., K) rising."""
    nodes, weights = gauss(count)
    return _spread(cuts, (nodes + 1) / 2, weights / 2)


def nodes_between_roots(cuts: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights, (..., (K-1) count), for square roots at the cuts.

    Cuts, (..., K), rise in any unit; nodes are in the same.
    Gauss nodes in the angle of a half circle over each piece make them analytic.
    """
    nodes, weights = gauss(count)
    turn = math.pi / 2 * (nodes + 1)
    return _spread(cuts, np.sin(turn / 2) ** 2, math.pi / 4 * weights * np.sin(turn))


def cuts_between(low: float, cuts: FloatArray, high: float) -> FloatArray:
    """Return the cuts, (N,) any unit, from `low` to `high`, rising, (K,)."""
    return np.unique(np.clip(np.concatenate([cuts, [low, high]]), low, high))


@cache
def gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Legendre nodes and weights in -1..1, (count,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def _spread(
    cuts: FloatArray, share: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return nodes at `share` of each piece, and `weight` times its length."""
    length = np.diff(cuts)[..., None]
    shape = (*cuts.shape[:-1], (cuts.shape[-1] - 1) * len(share))
    node = (cuts[..., :-1, None] + length * share).reshape(shape)
    return node, (length * weight).reshape(shape)
