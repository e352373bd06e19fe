"""Exact coverage of fine cells by an outline, arcs as chords."""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import EdgeArrays, clip
from microplan.optics.outline.outline import Outline

CHORD_UM = 1e-3  # sagitta of the chords that replace arcs
_ROUNDING = 1e-12  # of a cell: so little of sums is nothing, or all


def cells(
    outline: Outline | EdgeArrays,
    left_um: float,
    top_um: float,
    step_um: float,
    shape: tuple[int, int],
) -> FloatArray:
    """Return the covered share of square cells.

    Parameters
    ----------
    left_um, top_um : float
        The upper left corner of the first cell.
    step_um : float
        Side of a cell.
    shape : (rows, columns)
        Cells wanted; rows go down.

    Returns
    -------
    (rows, columns) float64 array
        0..1, rings counted by their winding number.
    """
    from microplan.optics.outline import area_loop  # loads a compiler

    rows, columns = shape
    right, bottom = left_um + columns * step_um, top_um - rows * step_um
    box = (left_um - step_um, bottom - step_um, right + step_um, top_um + step_um)
    corner = np.array([left_um, top_um] * 2)
    down = np.array([1.0, -1.0] * 2) / step_um
    ends = (_lines(clip(outline, box)) - corner) * down
    steps = np.zeros((rows, columns + area_loop.MORE))
    area_loop.add_steps(ends, steps)
    covered: FloatArray = np.cumsum(steps, axis=1)[:, 1 : columns + 1]
    covered -= _ROUNDING
    covered /= 1 - 2 * _ROUNDING
    return np.clip(covered, 0.0, 1.0)


def _lines(edges: EdgeArrays) -> FloatArray:
    """Return segments, and arcs as chords, (N, 4) um."""
    cx, cy, radius, start, sweep = edges.arcs.T
    turn = 2 * np.arccos(np.maximum(1 - CHORD_UM / radius, 0.5))
    count = np.maximum(np.ceil(np.abs(sweep) / turn).astype(np.intp), 1)
    arc = np.repeat(np.arange(radius.size), count)
    chord = np.arange(arc.size) - np.repeat(np.cumsum(count) - count, count)
    ends = []
    for k in (chord, chord + 1):
        angle = start[arc] + k / count[arc] * sweep[arc]
        ends += [cx[arc] + radius[arc] * np.cos(angle)]
        ends += [cy[arc] + radius[arc] * np.sin(angle)]
    return np.concatenate([edges.segments, np.stack(ends, axis=1)])
