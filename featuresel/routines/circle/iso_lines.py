"""Where an image crosses a level: points on the lines between pixel centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray

_ROUNDS = 4  # of Newton's method on a cubic, from the chord: settles below 1e-6 px


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossings:
    """Points where an image takes its level, and which way it does so there."""

    columns: FloatArray  # (N,) px
    rows: FloatArray  # (N,) px
    along_rows: BoolArray  # (N,) the point is between two pixels of one column
    rising: BoolArray  # (N,) the image grows with that row, or column


def crossings(above: FloatArray, wanted: BoolArray) -> Crossings:
    """Return where an image crosses zero between neighbouring pixels.

    Parameters
    ----------
    above : (rows, columns) float array
        The image less the level sought.
    wanted : (rows, columns) bool array
        Pixels between which, right and down of each, crossings are sought; two pixels
        of border never are, because a cubic needs four values.

    Returns
    -------
    Crossings
        By the cubic through four pixels in a line, so an edge's curvature does not pull
        its points towards pixel centres as a chord's would.
    """
    across = _between(above, wanted)
    down = _between(above.T, wanted.T)
    count = (len(across[0]), len(down[0]))
    return Crossings(
        columns=np.concatenate((across[1], down[0])),
        rows=np.concatenate((across[0], down[1])),
        along_rows=np.repeat((False, True), count),
        rising=np.concatenate((across[2], down[2])),
    )


def _between(
    above: FloatArray, wanted: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return line, place on it and whether it rises, of crossings along axis 1."""
    near, far = above[:, 1:-2], above[:, 2:-1]
    crossed = ((near < 0) != (far < 0)) & wanted[:, 1:-2]
    line, first = np.nonzero(crossed)
    values = [above[line, first + k] for k in range(4)]  # the crossing's pair: 1, 2
    return (
        line.astype(np.float64),
        first + 1 + _root(*values),
        np.asarray(values[2] > values[1]),
    )


def _root(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return where the cubic through values at -1, 0, 1, 2 is zero in 0..1."""
    second, third = (a - 2 * b + c) / 2, (d - 3 * c + 3 * b - a) / 6
    first = (c - a) / 2 - third
    t = np.asarray(b / (b - c), dtype=np.float64)
    for _ in range(_ROUNDS):
        value = b + t * (first + t * (second + t * third))
        tangent = first + t * (2 * second + 3 * t * third)
        # where noise makes the cubic flat, the chord's slope is good enough
        safe = np.where(tangent * (c - b) > 0.1 * (c - b) ** 2, tangent, c - b)
        t = np.clip(t - value / safe, 0.0, 1.0)
    return t
