"""Response of a camera: counts of a pixel over its light, and back."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from microplan.arrays import FloatArray

# of a power: its pieces err by less than .001 of the scale above .001 of the light
KNOTS = 128
LEAST_RISE = 1e-6  # of the scale from row to row: counts are told apart by far more


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Counts over light in straight pieces; beyond full scale the count stays.

    A camera whose first count is below 0 cuts darkness off.
    """

    shares: tuple[float, ...]  # light, of full scale: rising from 0 to 1
    counts: tuple[float, ...]  # rising

    def __post_init__(self) -> None:
        for name, values in (("shares", self.shares), ("counts", self.counts)):
            rises = all(a < b for a, b in itertools.pairwise(values))
            if len(values) < 2 or not rises or not all(map(math.isfinite, values)):
                raise ValueError(f"{name} must rise, 2 or more, got {values}")
        if len(self.shares) != len(self.counts):
            raise ValueError("shares and counts must be as many")
        if (self.shares[0], self.shares[-1]) != (0.0, 1.0):
            raise ValueError(f"shares must go from 0 to 1, got {self.shares}")

    @classmethod
    def from_levels(
        cls, rows: tuple[tuple[float, float], ...], black: float, white: float
    ) -> Self:
        """Return the response of rows of light and level, each 0..1 of its range.

        `black` and `white` are the counts at the levels 0 and 1.
        """
        shares, levels = zip(*rows, strict=True)
        counts = tuple(black + (white - black) * level for level in levels)
        return cls(shares=tuple(shares), counts=counts)

    @property
    def rows(self) -> tuple[tuple[float, float], ...]:
        """Return shares with their counts."""
        return tuple(zip(self.shares, self.counts, strict=True))

    def counts_of(self, share: FloatArray) -> FloatArray:
        """Return counts (...), not rounded, of light (...) as a share of full scale.

        Below 0, as noise may be, with the slope of `share_of` there.
        """
        below = np.minimum(share, 0.0) * self._slope_below
        found: FloatArray = np.interp(share, self.shares, self.counts) + below
        return found

    def share_of(self, counts: FloatArray) -> FloatArray:
        """Return light (...) as a share of full scale of counts (...), at most 1.

        Below 0 where counts are below those of darkness, as noise may bring them: with
        the slope of the first piece, or of the whole scale if that is steeper. A
        response that begins flat would make large lights of small noise.
        """
        below = np.minimum(counts - self.counts[0], 0.0) / self._slope_below
        found: FloatArray = np.interp(counts, self.counts, self.shares) + below
        return found

    @property
    def _slope_below(self) -> float:
        """Return counts per full scale of light below darkness."""
        first = (self.counts[1] - self.counts[0]) / self.shares[1]
        return max(first, self.counts[-1] - self.counts[0])


def power_rows(gamma: float) -> tuple[tuple[float, float], ...]:
    """Return rows of light and level of a camera whose level is light**gamma.

    Denser in the dark, where a power bends most; levels rise by `LEAST_RISE` at least.
    """
    if not (gamma > 0 and math.isfinite(gamma)):
        raise ValueError(f"gamma must be positive, got {gamma}")
    rows = [(0.0, 0.0)]
    for k in range(1, KNOTS):
        light = (k / KNOTS) ** 2
        if rows[-1][1] + LEAST_RISE < light**gamma < 1 - LEAST_RISE:
            rows.append((light, light**gamma))
    return (*rows, (1.0, 1.0))
