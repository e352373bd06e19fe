"""Systematic errors of a lens, and where they put the image of a point.

Everything is in object space: the image of a point is said as the object point at
which an ideal lens would have shown it, (x, y) um from the optical axis.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from optics.microscope import Microscope
from optics.scene import Illumination

FloatArray = npt.NDArray[np.float64]

# Barrel distortion of -1/3 at the corner would fold the field there; microscopes have
# less than a hundredth.
MAX_DISTORTION = 0.25
# Up to here, in corner radii, outlines follow the distortion; then the map goes on
# straight, since a cubic would fold or blow up bodies that reach far out of the field.
REACH = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LensErrors:
    """What is known of a lens' errors, and one standard deviation of what is not.

    Defocus is the height of a point minus that of the plane in focus. All are off by
    default.
    """

    # radial: r -> r (1 + distortion (r / r_corner)**2), r_corner half the diagonal of
    # the field at the setting in use; positive is a pincushion
    distortion: float = 0.0
    distortion_sigma: float = 0.0
    # shift of the image per um of defocus; the sigma is that of each axis
    lateral_x: float = 0.0
    lateral_y: float = 0.0
    lateral_sigma: float = 0.0
    # relative change of the magnification per um of defocus
    scale_per_um: float = 0.0
    scale_sigma_per_um: float = 0.0
    # 1 / R: a point r off the axis is imaged as one higher by r**2 / (2 R)
    field_curvature_per_um: float = 0.0
    field_curvature_sigma_per_um: float = 0.0
    # edges as made minus edges as drawn, positive where there is more material
    edge_offset_um: float = 0.0
    edge_offset_sigma_um: float = 0.0
    # relative change of brightness across the field, as in `Illumination`; the sigma
    # is that of each axis
    gradient_x: float = 0.0
    gradient_y: float = 0.0
    gradient_sigma: float = 0.0
    # (magnification, numerical aperture), magnifications rising; none: no change
    apertures: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if name == "apertures":
                continue
            if not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
            if "sigma" in name and value < 0:
                raise ValueError(f"{name} must not be negative, got {value}")
        if abs(self.distortion) > MAX_DISTORTION:
            raise ValueError(
                f"distortion must be at most {MAX_DISTORTION}, got {self.distortion}"
            )
        if not abs(self.gradient_x) + abs(self.gradient_y) < 2:
            raise ValueError("the gradients must not make the light vanish")
        _check_apertures(self.apertures)

    @property
    def moves_points(self) -> bool:
        """Return whether the known part displaces image points."""
        moves = (self.distortion, self.lateral_x, self.lateral_y, self.scale_per_um)
        return any(moves)

    @property
    def changes_scene(self) -> bool:
        """Return whether the known part changes what the renderer is given."""
        return self.moves_points or bool(
            self.field_curvature_per_um or self.edge_offset_um
        )

    def aperture_at(self, magnification: float) -> float:
        """Return the numerical aperture at a magnification.

        Between entries a power of the magnification, which is exact where a fixed stop
        behind the zoom limits the light.

        Raises
        ------
        ValueError
            If there is no table, or the magnification lies outside it.
        """
        table = self.apertures
        if not table or not table[0][0] <= magnification <= table[-1][0]:
            known = f"{table[0][0]}..{table[-1][0]}" if table else "none"
            raise ValueError(
                f"no aperture is known at magnification {magnification}; known: {known}"
            )
        m, A = np.log(np.array(table)).T
        return float(np.exp(np.interp(math.log(magnification), m, A)))


def _check_apertures(table: tuple[tuple[float, float], ...]) -> None:
    """Refuse a table that is no function, or of a single entry."""
    if not table:
        return
    flat = [number for entry in table for number in entry]
    if not all(number > 0 and math.isfinite(number) for number in flat):
        raise ValueError(f"apertures must be positive and finite, got {table}")
    below = [m for m, _ in table]
    if len(table) < 2 or any(b <= a for a, b in itertools.pairwise(below)):
        raise ValueError(
            f"apertures need two entries or more, magnifications rising, got {table}"
        )


def with_aperture(microscope: Microscope, errors: LensErrors) -> Microscope:
    """Return the setting with the aperture its zoom has; the same if none is known.

    Raises
    ------
    ValueError
        If the magnification is outside the table, or the aperture not below the index.
    """
    if not errors.apertures:
        return microscope
    aperture = errors.aperture_at(microscope.magnification)
    return replace(microscope, aperture=aperture)


def with_gradient(light: Illumination, errors: LensErrors) -> Illumination:
    """Return the light with the errors' gradient added; the same if there is none."""
    if not (errors.gradient_x or errors.gradient_y):
        return light
    return replace(
        light,
        gradient_x=light.gradient_x + errors.gradient_x,
        gradient_y=light.gradient_y + errors.gradient_y,
    )


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
    """Return `displaced`, which goes on straight beyond `REACH` corner radii.

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


def undisplaced(
    image_um: npt.ArrayLike,
    errors: LensErrors,
    microscope: Microscope,
    *,
    defocus_um: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Return which points the lens shows at `image_um`: the inverse of `displaced`.

    Parameters
    ----------
    image_um : (..., 2) float array
        What was measured, as object points of an ideal lens, um.
    errors, microscope, defocus_um
        As in `displaced`.

    Returns
    -------
    (..., 2) float64 array
        Points, um; by the closed root of the cubic, so no iteration can fail.

    Raises
    ------
    ValueError
        As `displaced`; also where no point is shown.
    """
    shown = _points(image_um)
    lateral, scale = _lateral(errors, defocus_um)
    d = errors.distortion
    if d != 0:
        s = _length(shown) / corner_um(microscope)
        shown = shown * _shrink(s, d)[..., None]
    return _finite("points", (shown - lateral) / scale)


def displacement_jacobian(
    points_um: npt.ArrayLike,
    errors: LensErrors,
    microscope: Microscope,
    *,
    defocus_um: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Return how the image of points moves with them and with their height.

    Arguments and errors as in `displaced`.

    Returns
    -------
    (..., 2, 3) float64 array
        Rows x and y of the image; columns x, y and defocus of the point, um per um.
    """
    points = _points(points_um)
    moved = _moved(points, errors, defocus_um)
    _, scale = _lateral(errors, defocus_um)
    displaced(points, errors, microscope, defocus_um=defocus_um)  # refuses what folds
    at = moved / corner_um(microscope)
    d = errors.distortion
    outer = at[..., :, None] * at[..., None, :]
    radial = (1 + d * (at**2).sum(axis=-1))[..., None, None] * np.eye(2) + 2 * d * outer
    slope = errors.scale_per_um * points + (errors.lateral_x, errors.lateral_y)
    inner = np.empty((*moved.shape, 3))
    inner[..., :2] = np.eye(2) * scale[..., None]
    inner[..., 2] = slope
    jacobian: FloatArray = radial @ inner
    return jacobian


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


def _shrink(share: FloatArray, distortion: float) -> FloatArray:
    """Return object over image radius at image radii (...) in corners.

    The root of r + d r**3 = s, by hyperbolic or circular functions of a third.
    """
    k = math.sqrt(3 * abs(distortion))
    s = np.where(share > 1e-100, share, 1e-100)  # there the ratio is 1 already
    if distortion > 0:
        ratio: FloatArray = 2 / k * np.sinh(np.arcsinh(1.5 * k * s) / 3) / s
        return ratio
    if not (1.5 * k * s <= 1).all():
        raise ValueError(
            f"nothing is shown at {share.max():.4g} corner radii with a distortion "
            f"of {distortion}"
        )
    return np.asarray(2 / k * np.sin(np.arcsin(1.5 * k * s) / 3) / s)


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
