"""Frames of one still scene, added up one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from microplan.arrays import FloatArray, IntArray

_CODES = 1 << 16  # counts that pictures of up to 16 bits have
_OUTLIER = 4.45  # times the median change: three standard deviations of a normal one
_ROUNDS = 2  # in which outliers are found: those of the first move the factor


@dataclass(slots=True, kw_only=True)
class StillScene:
    """What frames of a still scene amount to, in counts of the file.

    Memory does not grow with their number.
    """

    frames: int
    total: FloatArray  # (rows, columns): sum of all frames
    # (rows, columns): sum over successive frames of twice their variance, each frame's
    # common change of light taken off
    squares: FloatArray
    lowest: FloatArray  # (rows, columns)
    highest: FloatArray
    codes: IntArray  # (65536,): how often each count occurs
    top: int  # full scale, counts
    every: int  # of rows and columns one in so many is kept
    # (2, rows, columns): sum of all frames' slopes, down and across, counts a pixel of
    # the whole frame
    steep: FloatArray
    _last: FloatArray = field(repr=False)

    @classmethod
    def of(cls, first: FloatArray, top: int, *, every: int = 1) -> Self:
        """Return the scene after one frame, (rows, columns) counts 0..`top`.

        Of its rows and columns one in `every` is kept, of later frames, too.
        """
        steep = _steep(first, every)
        first = np.ascontiguousarray(first[::every, ::every])
        return cls(
            frames=1,
            total=first.copy(),
            squares=np.zeros(first.shape),
            lowest=first.copy(),
            highest=first.copy(),
            codes=_counted(first),
            top=top,
            every=every,
            steep=steep,
            _last=first,
        )

    def add(self, frame: FloatArray) -> None:
        """Add the next frame, (rows, columns) counts.

        Of two frames a, b whose light differs by a factor f the difference b - f a has
        (1 + f^2) times the variance of one. What is cut off tells no factor.
        """
        self.steep += _steep(frame, self.every)
        frame = np.ascontiguousarray(frame[:: self.every, :: self.every])
        factor = _common_factor(self._last, frame, self.top)
        change = frame - factor * self._last
        self.squares += change**2 * (2 / (1 + factor**2))
        self.frames += 1
        self.total += frame
        np.minimum(self.lowest, frame, out=self.lowest)
        np.maximum(self.highest, frame, out=self.highest)
        self.codes += _counted(frame)
        self._last = frame

    @property
    def mean(self) -> FloatArray:
        """Return the mean of all frames, (rows, columns) counts."""
        return self.total / self.frames

    @property
    def slopes(self) -> FloatArray:
        """Return the mean's slopes, (2, rows, columns) counts a pixel.

        Down and across, between neighbours in the whole frame; 0 of single lines.
        """
        return self.steep / self.frames

    @property
    def variance(self) -> FloatArray:
        """Return each pixel's variance in time, (rows, columns) counts squared.

        Of two frames or more.
        """
        return self.squares / (2 * (self.frames - 1))


def _steep(frame: FloatArray, every: int) -> FloatArray:
    """Return slopes down and across of the pixels kept, (2, rows, columns)."""
    found = []
    for axis in (0, 1):
        kept = np.arange(0, frame.shape[axis], every)
        lines = frame[:, ::every] if axis == 0 else frame[::every]
        before = np.maximum(kept - 1, 0)
        after = np.minimum(kept + 1, frame.shape[axis] - 1)
        rise = np.take(lines, after, axis) - np.take(lines, before, axis)
        over = np.maximum(after - before, 1)
        found.append(rise / (over[:, None] if axis == 0 else over))
    return np.stack(found)


def _common_factor(last: FloatArray, frame: FloatArray, top: int) -> float:
    """Return a frame's light over that of the last, 1 if no pixel shows it.

    Pixels whose change is an outlier are left out: at an edge that vibrates it is no
    change of light.
    """
    inside = (np.minimum(last, frame) > 0) & (np.maximum(last, frame) < top)
    before, after = last[inside], frame[inside]
    if not before.size:
        return 1.0
    factor = float(after.sum() / before.sum())
    for _ in range(_ROUNDS):
        off = after - factor * before
        off = np.abs(off - np.median(off))
        near = off <= _OUTLIER * np.median(off)
        factor = float(after[near].sum() / before[near].sum())
    return factor


def _counted(frame: FloatArray) -> IntArray:
    """Return how often each count occurs."""
    return np.bincount(frame.astype(np.intp).ravel(), minlength=_CODES)
