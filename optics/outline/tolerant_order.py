"""Tolerant order of numbers that differ by no more than machines do.

Another processor, BLAS, FFT or libm changes the last digits of a number. Where one of
several candidates is chosen by a number, all within a margin of the best are equal, and
what is declared first is taken. `docs/determinism.md` says how wide the noise is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

T = TypeVar("T")

MARGIN = 1e-6  # of the larger number: some thousand times the noise of float64 sums


def same(one: float, other: float, *, scale: float = 0.0) -> bool:
    """Return whether two numbers differ by MARGIN of the larger, or of `scale`."""
    if not (math.isfinite(one) and math.isfinite(other)):
        return one == other
    return abs(one - other) <= MARGIN * max(abs(one), abs(other), scale)


def at_most(value: float, limit: float, *, scale: float = 0.0) -> bool:
    """Return whether a value keeps a limit; one that equals it but for noise does."""
    return value <= limit or same(value, limit, scale=scale)


def above(value: float, limit: float, *, scale: float = 0.0) -> bool:
    """Return whether a value is above a limit by more than noise."""
    return not at_most(value, limit, scale=scale)


def least(items: Iterable[T], size: Callable[[T], float], *, scale: float = 0.0) -> T:
    """Return the first of the items whose size is within MARGIN of the least.

    Parameters
    ----------
    items : iterable
        At least one, the one to prefer among equals first.
    size : callable
        What is to be small; not nan.
    scale : float
        Terms of the sizes, where these may nearly vanish: the margin is of that,
        too.

    Raises
    ------
    ValueError
        If there is nothing to choose from.
    """
    sized = [(size(item), item) for item in items]
    best = min(found for found, _ in sized)
    return next(item for found, item in sized if at_most(found, best, scale=scale))


def ordered(
    items: Sequence[T], size: Callable[[T], float], *, scale: float = 0.0
) -> list[T]:
    """Return items by size, the least first; equal ones as they came.

    Those within MARGIN of the least that is left are equal to it, so that a chain of
    small differences is cut where it has grown to the margin. ValueError if a size is
    nan.
    """
    ranked = sorted(((size(item), at) for at, item in enumerate(items)))
    if any(math.isnan(value) for value, _ in ranked):
        raise ValueError("sizes must not be nan")
    groups: list[tuple[float, list[int]]] = []
    for value, at in ranked:
        # values rise: the first that is above a group's least begins another
        if groups and at_most(value, groups[-1][0], scale=scale):
            groups[-1][1].append(at)
        else:
            groups.append((value, [at]))
    return [items[at] for _, alike in groups for at in sorted(alike)]
