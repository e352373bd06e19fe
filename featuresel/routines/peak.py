"""The peak of a map of scores, between its samples, if it is the only one."""

from __future__ import annotations

import cv2
import numpy as np

from microplan.arrays import Float32Array
from microplan.featuresel.routines.contract import Failure

_RIVAL = 0.95  # of the best score, the most a peak elsewhere may reach


def find_peak(surface: Float32Array) -> tuple[float, float] | Failure:
    """Return the peak (column, row), px, of a (rows, columns) map of scores."""
    row, column = divmod(int(surface.argmax()), surface.shape[1])
    rows, columns = surface.shape
    if not (0 < row < rows - 1 and 0 < column < columns - 1):
        return Failure("outside", "the best match is at the search's rim")
    rival = _rival(surface, column, row)
    if rival > _RIVAL * float(surface[row, column]):
        return Failure(
            "ambiguous",
            f"scores {surface[row, column]:.3f} and {rival:.3f} at two places",
        )
    near = surface[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
    dx = (near[:, 2] - near[:, 0]).sum() / 6
    dy = (near[2] - near[0]).sum() / 6
    xx = (near[:, 0] - 2 * near[:, 1] + near[:, 2]).sum() / 3
    yy = (near[0] - 2 * near[1] + near[2]).sum() / 3
    xy = (near[0, 0] + near[2, 2] - near[0, 2] - near[2, 0]) / 4
    determinant = xx * yy - xy * xy
    if not (determinant > 0 and xx < 0):
        return Failure("no_peak", "the scores have no maximum")
    u, v = (xy * dy - yy * dx) / determinant, (xy * dx - xx * dy) / determinant
    return column + float(np.clip(u, -1, 1)), row + float(np.clip(v, -1, 1))


def _rival(surface: Float32Array, column: int, row: int) -> float:
    """Return the highest local maximum that is not the peak's own hill, else -1."""
    lifted = cv2.dilate(surface, np.ones((5, 5), np.uint8))
    tops = surface >= lifted
    tops[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4] = False
    return float(surface[tops].max()) if tops.any() else -1.0
