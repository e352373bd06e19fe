"""Response of a camera: counts of a pixel over its light, and back."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from microplan.arrays import FloatArray

KNOTS = (
    128  # of a power: it errs by less than .001 of the scale above .001 of the light
)


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

        Below 0, as noise may be, the first piece goes on.
        """
        below = np.minimum(share, 0.0) * self._slopes()[0]
        found: FloatArray = np.interp(share, self.shares, self.counts) + below
        return found

    def share_of(self, counts: FloatArray) -> FloatArray:
        """Return light (...) as a share of full scale of counts (...), at most 1.

        Below 0 where counts are below those of darkness, as noise may bring them.
        """
        below = np.minimum(counts - self.counts[0], 0.0) / self._slopes()[0]
        found: FloatArray = np.interp(counts, self.counts, self.shares) + below
        return found

    def slope_of(self, share: FloatArray) -> FloatArray:
        """Return counts per full scale of light (...) at shares (...), of its piece."""
        piece = np.searchsorted(self.shares, share, side="right") - 1
        found: FloatArray = self._slopes()[np.clip(piece, 0, len(self.shares) - 2)]
        return found

    def _slopes(self) -> FloatArray:
        slopes: FloatArray = np.diff(self.counts) / np.diff(self.shares)
        return slopes


def power_rows(gamma: float) -> tuple[tuple[float, float], ...]:
    """Return rows of light and level of a camera whose level is light**gamma.

    Denser in the dark, where a power bends most.
    """
    if not (gamma > 0 and math.isfinite(gamma)):
        raise ValueError(f"gamma must be positive, got {gamma}")
    lights = [(k / KNOTS) ** 2 for k in range(KNOTS + 1)]
    return tuple((light, light**gamma) for light in lights)
