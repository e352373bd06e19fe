"""Gauss nodes over pieces whose ends are known."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def nodes_between(cuts: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights between rising cuts, (..., K) to (..., (K - 1) count).

    Gauss nodes in the angle of a half circle over each piece, which makes square
    roots at its ends analytic.
    """
    nodes, weights = _gauss(count)
    turn = math.pi / 2 * (nodes + 1)
    half = (np.diff(cuts) / 2)[..., None]
    # 1 - cos keeps the digits of nodes close to the lower end
    node = cuts[..., :-1, None] + half * (2 * np.sin(turn / 2) ** 2)
    weight = half * (math.pi / 2 * weights * np.sin(turn))
    shape = (*cuts.shape[:-1], (cuts.shape[-1] - 1) * count)
    return node.reshape(shape), weight.reshape(shape)


def cuts_between(low: float, cuts: FloatArray, high: float) -> FloatArray:
    """Return the cuts from `low` to `high`, rising, each once."""
    return np.unique(np.clip(np.concatenate([cuts, [low, high]]), low, high))


@cache
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Legendre nodes and weights in -1..1, (count,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights
