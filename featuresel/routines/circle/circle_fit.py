"""Circles through points, some of which do not belong to one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.sampling import median

_ROUNDS = 12  # of reweighting: it settles to 1e-6 px in fewer
_SETTLED_PX = 1e-10  # a step after which the next changes nothing that is seen


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedCircle:
    """A circle or ellipse and the points that made it."""

    column: float
    row: float
    radius_px: float  # of an ellipse the geometric mean of the half axes
    flat: float = 1.0  # long axis over short one
    used: BoolArray  # (N,) points that were not trimmed
    rms_px: float  # of the radial residuals of the used points
    spread_px: float  # standard deviation of the centre per axis, from the residuals


def fit_centre(
    columns: FloatArray, rows: FloatArray, radius_px: float, start: tuple[float, float]
) -> tuple[float, float]:
    """Return the centre of a circle of known radius through (N,) points, px.

    Half of the points may be anywhere.

    Gauss-Newton with Cauchy weights whose scale shrinks from a third of the radius to
    half a pixel, so that far points pull first and wrong ones stop pulling later.
    """
    x, y = start
    for scale in np.geomspace(max(radius_px / 3, 0.5), 0.5, _ROUNDS):
        ux, uy, distance = _rays(columns - x, rows - y)
        residual = distance - radius_px
        weight = 1 / (1 + (residual / scale) ** 2)
        normal = np.array(
            [
                [(weight * ux * ux).sum(), (weight * ux * uy).sum()],
                [(weight * ux * uy).sum(), (weight * uy * uy).sum()],
            ]
        )
        right = np.array(
            [(weight * ux * residual).sum(), (weight * uy * residual).sum()]
        )
        step = np.linalg.solve(normal + 1e-9 * np.eye(2), right)
        x, y = x + float(step[0]), y + float(step[1])
    return (x, y)


def fit_circle(
    columns: FloatArray, rows: FloatArray, start: tuple[float, float, float]
) -> FittedCircle:
    """Return the circle through most of the points, geometric least squares.

    Parameters
    ----------
    columns, rows : (N,) float arrays
        Points, px; N >= 3.
    start : (column, row, radius)
        Near the answer, px.

    Returns
    -------
    FittedCircle
        Points farther from it than 3 robust standard deviations (at least .05 px, the
        pattern that sampling leaves) are trimmed; never more than half.
    """
    pose = np.array(start)
    used = np.ones(len(columns), dtype=bool)
    for k in range(2 * _ROUNDS):
        ux, uy, distance = _rays(columns - pose[0], rows - pose[1])
        residual = distance - pose[2]
        middle = median(residual)
        scale = max(1.4826 * median(np.abs(residual - middle)), 0.05 / 3)
        # soft weights first: trimming too early keeps a whole notch
        weight = 1 / (1 + ((residual - middle) / scale) ** 2)
        before, used = used, np.abs(residual - middle) <= 3 * scale
        if k >= _ROUNDS:
            weight = used.astype(np.float64)
        jacobian = np.column_stack((ux, uy, np.ones_like(ux)))
        root = np.sqrt(weight)
        step, *_ = np.linalg.lstsq(jacobian * root[:, None], residual * root)
        pose = pose + step
        settled = float(np.abs(step).max()) < _SETTLED_PX
        if k > _ROUNDS and settled and np.array_equal(used, before):
            break
    rms = float(np.sqrt(np.mean((residual[used] - residual[used].mean()) ** 2)))
    inverse = np.linalg.pinv(jacobian[used].T @ jacobian[used])
    spread = rms * float(np.sqrt((inverse[0, 0] + inverse[1, 1]) / 2))
    return FittedCircle(
        column=float(pose[0]),
        row=float(pose[1]),
        radius_px=float(pose[2]),
        used=used,
        rms_px=rms,
        spread_px=spread,
    )


def _rays(dx: FloatArray, dy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors and lengths; a point at the centre points nowhere."""
    distance = np.hypot(dx, dy)
    safe = np.maximum(distance, 1e-9)
    return dx / safe, dy / safe, distance
