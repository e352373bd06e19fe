"""Counts at which a camera is cut off, and steps between its counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import IntArray

_PILE = 8.0  # times as often as the counts below it on average: saturation
_BELOW = 8  # such counts


@dataclass(frozen=True, slots=True, kw_only=True)
class CountLevels:
    """Shares of all counts, and which of them occur."""

    step: int  # all counts are multiples of it
    highest: int  # count that occurs
    dark_share: float  # of counts that are 0
    white_level: int | None  # at which many counts end; None: none do
    white_share: float  # of counts at that level


def count_levels(codes: IntArray, top: int) -> CountLevels:
    """Return where counts are cut off.

    Parameters
    ----------
    codes : (N,) int array
        How often each count occurs.
    top : int
        The full scale: what is there is saturated, however rare.
    """
    seen, total = np.flatnonzero(codes), int(codes.sum())
    step = max(int(np.gcd.reduce(seen)), 1)
    highest = int(seen[-1])
    below = codes[max(highest - _BELOW * step, 0) : highest : step]
    piled = bool(below.size) and codes[highest] > _PILE * max(float(below.mean()), 1.0)
    is_white = highest > 0 and (piled or highest >= top)
    return CountLevels(
        step=step,
        highest=highest,
        dark_share=float(codes[0] / total),
        white_level=highest if is_white else None,
        white_share=float(codes[highest] / total) if is_white else 0.0,
    )
