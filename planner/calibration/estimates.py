"""Estimates with standard deviations, by the jackknife over blocks, or a refusal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from microplan.arrays import FloatArray

FEWEST_BLOCKS = 6  # with fewer a standard deviation is not stated

Block = TypeVar("Block")


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockEstimate:
    """One number with what is known of its error."""

    value: float
    sigma: float | None  # one standard deviation; None: too few blocks
    method: str
    blocks: int  # that err independently


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorEstimate:
    """Several numbers of the same blocks."""

    values: FloatArray  # (N,)
    covariance: FloatArray | None  # (N, N); None: too few blocks
    method: str
    blocks: int

    def one(self, index: int) -> BlockEstimate:
        """Return one of the numbers."""
        sigma = None
        if self.covariance is not None:
            sigma = math.sqrt(float(self.covariance[index, index]))
        return BlockEstimate(
            value=float(self.values[index]),
            sigma=sigma,
            method=self.method,
            blocks=self.blocks,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """Why pictures do not tell a number, and which pictures do."""

    what: str  # the number
    why: str
    take: str  # what to photograph instead


def jackknife(
    statistic: Callable[[Sequence[Block]], float],
    blocks: Sequence[Block],
    *,
    method: str = "jackknife",
) -> BlockEstimate:
    """Return a statistic of all blocks, its deviation by leaving out one at a time.

    Parameters
    ----------
    statistic : callable
        From a sequence of blocks to a number.
    blocks : sequence
        What errs independently: parts, fields, steps. Frames of one still scene do not:
        they share its errors.
    method : str
        Name of the statistic.

    Raises
    ------
    ValueError
        If there is no block.

    References
    ----------
    Efron & Tibshirani (1993), An Introduction to the Bootstrap, eq. (11.5).
    """
    return jackknife_vector(
        lambda some: np.array([statistic(some)]), blocks, method=method
    ).one(0)


def jackknife_vector(
    statistic: Callable[[Sequence[Block]], FloatArray],
    blocks: Sequence[Block],
    *,
    method: str = "jackknife",
) -> VectorEstimate:
    """Return a statistic of several numbers, (N,), in any unit [1].

    As `jackknife` does one number.
    """
    if not blocks:
        raise ValueError("blocks must not be empty")
    values = np.asarray(statistic(blocks), dtype=np.float64)
    without: list[FloatArray] = []
    if len(blocks) >= FEWEST_BLOCKS:
        for left in range(len(blocks)):
            kept = [*blocks[:left], *blocks[left + 1 :]]
            without.append(np.asarray(statistic(kept), dtype=np.float64))
    return VectorEstimate(
        values=values,
        covariance=jackknife_covariance(without),
        method=method,
        blocks=len(blocks),
    )


def jackknife_covariance(without: Sequence[FloatArray]) -> FloatArray | None:
    """Return the covariance (N, N) of a statistic from its values without each block.

    In the square of the values' unit, of shares [1].

    Parameters
    ----------
    without : sequence of (N,) float array
        One of each block.

    Returns
    -------
    (N, N) float array or None
        None for fewer than `FEWEST_BLOCKS` blocks, or where one of the values is not
        finite.
    """
    if len(without) < FEWEST_BLOCKS or not np.isfinite(without).all():
        return None
    off = np.asarray(without, dtype=np.float64)
    off = off - off.mean(axis=0)
    covariance: FloatArray = off.T @ off * ((len(without) - 1) / len(without))
    return covariance


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
