"""Coverage of fine cells by an outline, by scan lines."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import EdgeArrays, clip
from microplan.optics.outline.outline import Outline

CHORD_UM = 1e-3  # sagitta of the chords that replace arcs
LINES = 8  # scan lines a cell: exact along a line, a sixteenth of a cell across


def cells(
    outline: Outline | EdgeArrays,
    left_um: float,
    top_um: float,
    step_um: float,
    shape: tuple[int, int],
    lines: int = LINES,
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
    lines : int
        Scan lines a cell.

    Returns
    -------
    (rows, columns) float64 array
        0..1, rings counted by their winding number.
    """
    rows, columns = shape
    right, bottom = left_um + columns * step_um, top_um - rows * step_um
    box = (left_um - step_um, bottom - step_um, right + step_um, top_um + step_um)
    x0, y0, x1, y1 = _lines(clip(outline, box)).T
    fine = step_um / lines
    # a scan line k lies at height top - (k + 1/2) fine, in units of `fine` from the top
    a, b = (top_um - y0) / fine - 0.5, (top_um - y1) / fine - 0.5
    low = np.ceil(np.minimum(a, b)).astype(np.intp)
    count = np.maximum(np.ceil(np.maximum(a, b)).astype(np.intp) - low, 0)
    edge = np.repeat(np.arange(a.size), count)
    first = np.cumsum(count) - count
    line = np.arange(edge.size) - first[edge] + low[edge]
    share = (line - a[edge]) / (b - a)[edge]
    x = (x0[edge] + share * (x1 - x0)[edge] - left_um) / step_um
    sign = np.where(b > a, 1.0, -1.0)[edge]  # down the frame: the inside lies right
    keep = (line >= 0) & (line < rows * lines)
    return _filled(x[keep], line[keep] // lines, sign[keep] / lines, shape)


def _filled(
    x: FloatArray, row: npt.NDArray[np.intp], sign: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """Sum up what lies right of crossings at `x`, in cells."""
    rows, columns = shape
    x = np.clip(x, 0.0, columns)
    column = np.minimum(x.astype(np.intp), columns - 1)
    here = sign * (column + 1 - x)
    at = row * (columns + 1) + column
    size = rows * (columns + 1)
    steps = np.bincount(at, here, size) + np.bincount(at + 1, sign - here, size)
    covered: FloatArray = np.cumsum(steps.reshape(rows, columns + 1), axis=1)
    return np.clip(covered[:, :columns], 0.0, 1.0)


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
