"""Displacement of image points by an imperfect lens.

Everything is in object space: the image of a point is given as the object point at
which an ideal lens would have shown it, (x, y) um from the optical axis.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.lens.lens import LensErrors
from microplan.optics.transfer.microscope import Microscope

# Up to here, in corner radii, outlines follow the distortion; then the map goes on
# straight, since a cubic would fold or blow up bodies that reach far out of the field.
REACH = 1.1


def corner_um(microscope: Microscope) -> float:
    """Return how far a corner of the field is from the axis, um."""
    return math.hypot(*microscope.field_um) / 2


def displaced(
    points_um: npt.ArrayLike,
    errors: LensErrors,
    microscope: Microscope,
    *,
    defocus_um: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Return where the lens shows points.

    Parameters
    ----------
    points_um : (..., 2) float array
        Points (x, y) from the optical axis, um.
    errors : LensErrors
        The lens; its sigmas do nothing here.
    microscope : Microscope
        The optical setting, whose field the distortion refers to.
    defocus_um : (...) float array
        Height of each point minus that of the plane in focus, field curvature left out:
        it moves the best focus, not the chief ray.

    Returns
    -------
    (..., 2) float64 array
        First scaled and shifted with the defocus, then distorted; um.

    Raises
    ------
    ValueError
        If a number is not finite, if the scale is not positive at a defocus, or where a
        barrel distortion folds the image: beyond r_corner / sqrt(-3 distortion).
    """
    moved = _moved(points_um, errors, defocus_um)
    if errors.distortion == 0:
        return moved
    share = _length(moved) / corner_um(microscope)
    with np.errstate(over="ignore", invalid="ignore"):
        square = errors.distortion * share**2
        if not (1 + 3 * square > 0).all():
            raise ValueError(
                f"a point at {share.max():.4g} corner radii is where a distortion of "
                f"{errors.distortion} folds the image"
            )
        return _finite("image points", moved * (1 + square)[..., None])


def displaced_far(
    points_um: npt.ArrayLike,
    errors: LensErrors,
    microscope: Microscope,
    *,
    defocus_um: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Return points (..., 2) um `displaced`, linearly beyond `REACH` corner radii.

    One to one everywhere and smooth, for outlines that reach far out of the field.
    """
    moved = _moved(points_um, errors, defocus_um)
    d = errors.distortion
    if d == 0:
        return moved
    share = _length(moved) / corner_um(microscope)
    near, far = np.minimum(share, REACH), np.maximum(share, REACH)
    # value and slope of r (1 + d r**2) at the reach
    straight = (1 + 3 * d * REACH**2) - 2 * d * REACH**3 / far
    factor = np.where(share <= REACH, 1 + d * near**2, straight)
    return moved * factor[..., None]


def _moved(
    points_um: npt.ArrayLike, errors: LensErrors, defocus_um: npt.ArrayLike
) -> FloatArray:
    """Scale and shift points (..., 2) with their defocus."""
    points = _points(points_um)
    lateral, scale = _lateral(errors, defocus_um)
    with np.errstate(over="ignore", invalid="ignore"):
        return _finite("image points", points * scale + lateral)


def _lateral(
    errors: LensErrors, defocus_um: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return shift (..., 2) um and scale (..., 1) at a defocus."""
    z = _finite("defocus_um", np.asarray(defocus_um, dtype=np.float64))[..., None]
    scale = 1 + errors.scale_per_um * z
    if not (scale > 0).all():
        raise ValueError(
            f"scale_per_um {errors.scale_per_um} leaves no image at {z.min()} um"
        )
    return z * np.array([errors.lateral_x, errors.lateral_y]), scale


def _length(points: FloatArray) -> FloatArray:
    """Return the distance from the axis of points (..., 2)."""
    length: FloatArray = np.hypot(points[..., 0], points[..., 1])
    return length


def _points(points_um: npt.ArrayLike) -> FloatArray:
    points = np.asarray(points_um, dtype=np.float64)
    if points.ndim < 1 or points.shape[-1] != 2:
        raise ValueError(f"points must be (..., 2), got {points.shape}")
    return _finite("points", points)


def _finite(name: str, values: FloatArray) -> FloatArray:
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite")
    return values
