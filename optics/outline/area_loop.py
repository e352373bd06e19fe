"""The loop over an outline's edges: what each changes of the cells it runs through.

Compiled: every edge meets its own number of cells.
"""

from __future__ import annotations

import math

from microplan.arrays import FloatArray
from microplan.compiled import compiled

MORE = 4  # columns of steps: one before the first cell, three after the last


@compiled
def add_steps(ends: FloatArray, steps: FloatArray) -> None:
    """Add what edges change of coverage from cell to cell along rows, in place.

    Parameters
    ----------
    ends : (N, 4) float64 array
        x and y of both ends of edges, in cells from the upper left corner, x within a
        cell of the frame; the inside lies to the right where an edge goes down.
    steps : (rows, columns + `MORE`) float64 array, in and out
        Their sums along a row, from its second value on, are coverages.

    Notes
    -----
    An edge from x0 to x1 across a part of a row covers of each column the area to its
    right: a trapezium of the one, all of the next (as fonts are filled).
    """
    rows = steps.shape[0]
    for n in range(ends.shape[0]):
        x, y, x1, y1 = ends[n, 0] + 1.0, ends[n, 1], ends[n, 2] + 1.0, ends[n, 3]
        sign = 1.0
        if y1 < y:
            x, y, x1, y1, sign = x1, y1, x, y, -1.0
        if y1 <= 0.0 or y >= rows or y == y1:
            continue
        slope = (x1 - x) / (y1 - y)
        if y < 0.0:
            x, y = x - slope * y, 0.0
        row = int(y)
        while y < y1 and row < rows:
            below = min(row + 1.0, y1)
            after = x + slope * (below - y)
            _add_row(steps[row], min(x, after), max(x, after), sign * (below - y))
            x, y, row = after, below, row + 1


@compiled
def _add_row(steps: FloatArray, low: float, high: float, share: float) -> None:
    """Add an edge's steps to a row of which it crosses a share, from x to x."""
    first, last = int(low), int(math.floor(high))
    if last <= first:
        right = (low + high) / 2 - first
        steps[first] += share * (1 - right)
        steps[first + 1] += share * right
        return
    rise, passed, before = share / (high - low), 0.0, 0.0
    for k in range(first, last + 1):
        start, stop = max(low, float(k)), min(high, k + 1.0)
        own = (stop - start) * (k + 1 - (start + stop) / 2)
        covered = rise * (passed + own)
        steps[k] += covered - before
        passed, before = passed + stop - start, covered
    steps[last + 1] += share - before
