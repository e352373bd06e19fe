"""Standard deviations of estimates, by the jackknife over blocks."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray

FEWEST_BLOCKS = 6  # with fewer a standard deviation is not stated


def jackknife_sigma(sums: FloatArray, counts: FloatArray) -> float | None:
    """Return the standard deviation of a mean over blocks that err together.

    Parameters
    ----------
    sums, counts : (N,) float array
        Of each block's values; blocks of no value are left out.

    Returns
    -------
    float or None
        None for fewer than `FEWEST_BLOCKS` blocks.

    References
    ----------
    Efron & Tibshirani (1993), An Introduction to the Bootstrap, eq. (11.5).
    """
    some = counts > 0
    sums, counts = sums[some], counts[some]
    blocks = len(counts)
    if blocks < FEWEST_BLOCKS:
        return None
    without = (sums.sum() - sums) / (counts.sum() - counts)
    squares = float(np.sum((without - without.mean()) ** 2))
    return math.sqrt(squares * (blocks - 1) / blocks)
