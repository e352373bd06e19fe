"""Stretches of a closed line along which something stays the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, FloatArray

IntArray = npt.NDArray[np.int64]

_HALVINGS = 24  # of the way between two samples: 1e-7 of it is left


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleRun:
    """Samples first .. last of a closed line of `count`, which may go on at its start.

    `last` is at least `first`, and below `first + count`.
    """

    kind: int
    first: int
    last: int

    @property
    def samples(self) -> int:
        """Return how many samples it has."""
        return self.last - self.first + 1


def runs(kinds: IntArray, least: int) -> list[SampleRun]:
    """Return the runs of equal kinds along a closed line.

    Parameters
    ----------
    kinds : (N,) int array
        What each sample is, N >= 1; negative kinds are never changed.
    least : int
        A run of fewer samples between two of one kind becomes one with them.

    Returns
    -------
    list of Run
        In order; one run if all are equal. None begins before the line does.
    """
    found = _split(kinds)
    while lost := _lost(found, least):
        kinds = kinds.copy()
        for index in lost:
            run = found[index]
            where = np.arange(run.first, run.last + 1) % len(kinds)
            kinds[where] = found[index - 1].kind
        found = _split(kinds)
    return found


def border(
    inside: Callable[[FloatArray], BoolArray], within: FloatArray, beyond: FloatArray
) -> FloatArray:
    """Return the last places, (N,), of which `inside` still holds.

    It holds at `within` and not at `beyond`, (N,) each; found by bisection.
    """
    low, high = within.copy(), beyond.copy()
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        holds = inside(middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return low


def _split(kinds: IntArray) -> list[SampleRun]:
    """Return the runs of equal kinds along a closed line."""
    count = len(kinds)
    begins = np.flatnonzero(kinds != np.roll(kinds, 1))
    if len(begins) == 0:
        return [SampleRun(kind=int(kinds[0]), first=0, last=count - 1)]
    ends = np.append(begins[1:], begins[0] + count) - 1
    return [
        SampleRun(kind=int(kinds[first]), first=int(first), last=int(last))
        for first, last in zip(begins, ends, strict=True)
    ]


def _lost(found: list[SampleRun], least: int) -> list[int]:
    """Return the shortest runs that stand between two alike, no two of them adjacent.

    Those of `least` samples and more are never among them.
    """
    between = [
        index
        for index, run in enumerate(found)
        if run.samples < least
        and min(run.kind, found[index - 1].kind) >= 0
        and found[index - 1].kind == found[(index + 1) % len(found)].kind != run.kind
    ]
    shortest = min((found[index].samples for index in between), default=0)
    lost: list[int] = []
    for index in between:
        if found[index].samples == shortest and (not lost or index > lost[-1] + 1):
            lost.append(index)
    if len(lost) > 1 and lost[0] == 0 and lost[-1] == len(found) - 1:
        lost.pop()  # the last and the first are neighbours
    return lost
