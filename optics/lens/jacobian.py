"""Image Jacobian: motion of image points with pose, zoom.

Image points are (column, row) pixels; rows go down. It replaces eqs. (13, 14, 16) of
the paper, whose printed rotation column is no rotation.
"""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope


def to_px(points_um: FloatArray, microscope: Microscope) -> FloatArray:
    """Return (column, row) of world points (..., 2) um, same shape."""
    points = np.asarray(points_um, dtype=np.float64)
    k = microscope.px_per_um
    pixels: FloatArray = _axis_px(microscope) + points * np.array([k, -k])
    return pixels


def point_jacobian(
    points_px: FloatArray,
    microscope: Microscope,
    *,
    axis_um: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return how image points move with pose and zoom.

    Parameters
    ----------
    points_px : (N, 2) float array
        Columns and rows, measured.
    axis_um : (x, y)
        World point of the body's rotation. Where the stage rotates, this is the stage's
        axis, not the middle of the image.

    Returns
    -------
    (2 N, 4) float64 array
        Two rows a point: column and row, px. Columns: x and y per um, theta per rad
        counter-clockwise, magnification per relative change.

    Raises
    ------
    ValueError
        If `points_px` is not (N, 2) or not finite.

    References
    ----------
    Feddema & Simon (1998), eqs. (13, 14, 16), with the rotation column (-y', +x') and
    a zoom column added.
    """
    points = _points(points_px)
    k = microscope.px_per_um
    column, row = (points - to_px(np.array(axis_um), microscope)).T
    from_centre = points - _axis_px(microscope)
    jacobian = np.zeros((len(points), 2, 4))
    jacobian[:, 0, 0] = k
    jacobian[:, 1, 1] = -k
    jacobian[:, 0, 2] = row
    jacobian[:, 1, 2] = -column
    jacobian[:, :, 3] = from_centre
    return jacobian.reshape(-1, 4)


def _axis_px(microscope: Microscope) -> FloatArray:
    """Return (column, row) of the optical axis."""
    return np.array([(microscope.width_px - 1) / 2, (microscope.height_px - 1) / 2])


def _points(points_px: FloatArray) -> FloatArray:
    points = np.asarray(points_px, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points_px must be (N, 2), got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("points_px must be finite")
    return points
