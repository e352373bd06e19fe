"""What measured image points tell about the pose of the body that carries them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.limits.information import Information
from microplan.optics.lens.jacobian import point_jacobian
from microplan.optics.transfer.microscope import Microscope

_ANGLE = 1e-12  # rad, what rounding leaves of the direction of an edge
_COLUMNS = (
    "x",
    "y",
    "theta",
    "zoom",
)  # of `microplan.optics.lens.jacobian.point_jacobian`


def pose_information(
    points_px: FloatArray,
    precision: FloatArray,
    microscope: Microscope,
    *,
    axis_um: tuple[float, float] = (0.0, 0.0),
    names: Sequence[str] = _COLUMNS[:3],
) -> Information:
    """Return J^T R^-1 J summed over points.

    Parameters
    ----------
    points_px : (N, 2) float array
        Columns and rows in the frame.
    precision : (N, 2, 2) float array
        Inverse of each point's covariance, per px squared; singular for a point on an
        edge, see `across`.
    microscope : Microscope
        The optical setting.
    axis_um : (x, y)
        World point that theta turns about.
    names : sequence of str
        What is unknown, of x, y, theta, zoom; units as in
        `microplan.featuresel.look.sensitivity`.

    Raises
    ------
    ValueError
        If a name is unknown, shapes do not fit or a precision is no covariance's.
    """
    unknown = sorted(set(names) - set(_COLUMNS))
    if unknown:
        raise ValueError(f"points tell nothing about {unknown}, only {_COLUMNS}")
    weight = np.asarray(precision, dtype=np.float64)
    if weight.shape != (len(points_px), 2, 2) or not np.isfinite(weight).all():
        raise ValueError(
            f"precision must be ({len(points_px)}, 2, 2) and finite, got {weight.shape}"
        )
    lean = np.abs(weight - weight.transpose(0, 2, 1)).max(initial=0.0)
    values = np.linalg.eigvalsh(weight)
    rounding = 1e-12 * np.abs(weight).max(initial=0.0)
    if lean > rounding or values.min(initial=0.0) < -rounding:
        raise ValueError("precision must be symmetric and not negative")
    moves = point_jacobian(points_px, microscope, axis_um=axis_um).reshape(-1, 2, 4)
    moves = moves[:, :, [_COLUMNS.index(name) for name in names]]
    size = np.trace(weight, axis1=1, axis2=2)
    return Information(
        names=tuple(names),
        matrix=np.einsum("nip,nij,njq->pq", moves, weight, moves),
        faked=_ANGLE**2 * np.einsum("nip,n->p", moves**2, size),
    )


def across(angle_rad: float, sigma_px: float) -> FloatArray:
    """Return the precision of a point on an edge, (2, 2) per px squared.

    Parameters
    ----------
    angle_rad : float
        Of the edge's normal, counter-clockwise as displayed.
    sigma_px : float
        Along the normal, > 0; along the edge nothing is known.
    """
    if not (sigma_px > 0 and math.isfinite(angle_rad)):
        raise ValueError(f"sigma_px must be positive, got {sigma_px} at {angle_rad}")
    normal = np.array([math.cos(angle_rad), -math.sin(angle_rad)])  # rows go down
    found: FloatArray = np.outer(normal, normal) / sigma_px**2
    return found
