"""How much of a target is seen: in the region, and nothing in front of it."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Occluders, Target

# Of the most light that any of the edges sends through: at the middle of a blurred edge
# of what stands in front half of it comes through.
_THROUGH = 0.5
_DARK = 0.05  # of unshaded light: less is no sight, even where no edge has more


def seen_share(target: Target, occluders: Occluders) -> float | None:
    """Return the share of a target's edges that is seen at its nominal pose.

    Parameters
    ----------
    target : Target
        With its contour, whose points are evenly along the edges.
    veil : Veil
        What stands in front, (rows, columns) of the region.

    Returns
    -------
    float or None
        0..1; None for a target without a contour.
    """
    if not target.contour:
        return None
    column, row = contour_px(target)
    rows, columns = occluders.through.shape
    # pixels' areas reach half a pixel beyond their centres
    inside = (column > -0.5) & (column < columns - 0.5)
    inside &= (row > -0.5) & (row < rows - 0.5)
    at = (
        np.rint(row[inside]).astype(np.intp).clip(0, rows - 1),
        np.rint(column[inside]).astype(np.intp).clip(0, columns - 1),
    )
    through = occluders.through[at]
    least = max(_DARK, _THROUGH * float(through.max(initial=0.0)))
    return float(np.count_nonzero(through > least) / len(column))


def contour_px(target: Target) -> tuple[FloatArray, FloatArray]:
    """Return columns and rows, (N,) px each, of a target's contour at its nominal pose.

    The target must have one.
    """
    x, y = np.array(target.contour)[:, :2].T
    c, s = math.cos(target.theta_rad), math.sin(target.theta_rad)
    column = target.column + target.px_per_um * (c * x - s * y)
    row = target.row - target.px_per_um * (s * x + c * y)
    return column, row
