"""How image features move with pose and zoom: the image Jacobian and its inverse.

Image points are (column, row) pixels; rows go down. It replaces eqs. (13-16) of the
paper: the rotation column printed there is no rotation, and the blur's column lacks
the sign of the defocus.
"""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope


def to_px(points_um: FloatArray, microscope: Microscope) -> FloatArray:
    """Return (column, row) of world points (..., 2) um, same shape."""
    points = np.asarray(points_um, dtype=np.float64)
    k = microscope.px_per_um
    pixels: FloatArray = _axis_px(microscope) + points * np.array([k, -k])
    return pixels


def to_um(points_px: FloatArray, microscope: Microscope) -> FloatArray:
    """Return world points, um, of (column, row) pixels (..., 2), same shape."""
    points = np.asarray(points_px, dtype=np.float64)
    k = microscope.px_per_um
    world: FloatArray = (points - _axis_px(microscope)) / np.array([k, -k])
    return world


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
    microscope : Microscope
        The optical setting.
    axis_um : (x, y)
        World point the body turns about. Where the stage turns, this is the stage's
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


def blur_jacobian(z_um: FloatArray, microscope: Microscope) -> FloatArray:
    """Return how blur diameters change with height and zoom.

    Parameters
    ----------
    z_um : (N,) float array
        Defocus: height of the feature minus that of the plane in focus.
    microscope : Microscope
        The optical setting.

    Returns
    -------
    (N, 2) float64 array
        px per um of height, negative below focus and 0 at it; px per relative change
        of the magnification.

    Raises
    ------
    ValueError
        If `z_um` is not finite.

    References
    ----------
    Feddema & Simon (1998), eqs. (14, 15), with the sign of the defocus and the marginal
    ray's diameter, 2 |z| A / sqrt(n**2 - A**2).
    """
    z = np.asarray(z_um, dtype=np.float64)
    if not np.isfinite(z).all():
        raise ValueError("z_um must be finite")
    slope = microscope.px_per_um * microscope.blur_diameter_um(1.0)
    return np.stack([slope * np.sign(z), slope * np.abs(z)], axis=-1)


def image_jacobian(
    points_px: FloatArray,
    z_um: FloatArray,
    microscope: Microscope,
    *,
    axis_um: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the stacked Jacobian of points with their blur.

    Parameters
    ----------
    points_px : (N, 2) float array
        Columns and rows, measured.
    z_um : (N,) float array
        Defocus of each point.
    microscope : Microscope
        The optical setting.
    axis_um : (x, y)
        World point the body turns about.

    Returns
    -------
    (3 N, 5) float64 array
        Three rows a point: column, row and blur diameter, px. Columns: x, y, z per um,
        theta per rad, magnification per relative change.

    Raises
    ------
    ValueError
        If the shapes do not fit or a number is not finite.
    """
    points = _points(points_px)
    blur = blur_jacobian(z_um, microscope)
    if blur.shape != (len(points), 2):
        raise ValueError(f"z_um must be ({len(points)},), got {np.shape(z_um)}")
    jacobian = np.zeros((len(points), 3, 5))
    moves = point_jacobian(points, microscope, axis_um=axis_um)
    jacobian[:, :2, [0, 1, 3, 4]] = moves.reshape(-1, 2, 4)
    jacobian[:, 2, [2, 4]] = blur
    return jacobian.reshape(-1, 5)


def pseudo_inverse(
    jacobian: FloatArray, scale: FloatArray, *, smallest: float = 1e-6
) -> FloatArray:
    """Return the least-squares inverse, computed in scaled columns.

    Parameters
    ----------
    jacobian : (R, C) float array
        Any stack of rows.
    scale : (C,) float array
        A typical move of each column, > 0: 1 um, and 1 um over the part's radius for
        an angle. Without it radians drown in micrometres.
    smallest : float
        Singular values below this share of the largest count as zero.

    Returns
    -------
    (C, R) float64 array
        The smallest scaled move for a wanted change of the features.

    Raises
    ------
    ValueError
        If the scale does not fit the columns or is not positive.
    """
    weights = _scale(jacobian, scale)
    inverse: FloatArray = weights[:, None] * np.linalg.pinv(
        jacobian * weights, rcond=smallest
    )
    return inverse


def conditioning(jacobian: FloatArray, scale: FloatArray) -> float:
    """Return largest over smallest singular value in scaled columns, or infinity.

    Arguments and errors as in `pseudo_inverse`; more columns than rows are singular.
    """
    weights = _scale(jacobian, scale)
    values = np.linalg.svd(jacobian * weights, compute_uv=False)
    if values.size < jacobian.shape[1] or values[-1] <= values[0] * 1e-14:
        return math.inf
    return float(values[0] / values[-1])


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


def _scale(jacobian: FloatArray, scale: FloatArray) -> FloatArray:
    weights = np.asarray(scale, dtype=np.float64)
    if jacobian.ndim != 2 or weights.shape != (jacobian.shape[1],):
        raise ValueError(
            f"scale must be one number a column of {jacobian.shape}, "
            f"got {weights.shape}"
        )
    if not (weights > 0).all():  # also refuses nan
        raise ValueError(f"scale must be positive, got {weights}")
    return weights
