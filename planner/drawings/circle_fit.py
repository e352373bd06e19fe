"""The circle that corners of a polygon lie on."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray


def fit_circle(corners: FloatArray) -> tuple[tuple[float, float], float]:
    """Return centre and radius of the circle nearest to points, in least squares.

    Minimises the sum of ((r_k^2 - R^2) / 2)^2, which is linear in the centre and in
    R^2 (Kasa, IEEE Trans. Instrum. Meas. 25, 8, 1976).
    """
    mean = corners.mean(axis=0)
    x, y = (corners - mean).T
    rows = np.column_stack([2 * x, 2 * y, np.ones_like(x)])
    (cx, cy, rest), *_ = np.linalg.lstsq(rows, x * x + y * y, rcond=None)
    radius = math.sqrt(max(rest + cx * cx + cy * cy, 0.0))
    center = (_rounded(mean[0] + cx), _rounded(mean[1] + cy))
    return center, _rounded(radius)


def _rounded(value: float) -> float:
    """Return a length to 1e-9 um, so that a centre at 0 is at 0."""
    return round(float(value), 9) + 0.0
