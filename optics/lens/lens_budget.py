"""Shifts of a target by the errors of a lens, nm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.lens.displacement import corner_um, displaced
from microplan.optics.lens.distorted_scene import curvature_rest_um
from microplan.optics.lens.gradient import (
    centroid_shift_um,
    relative_gradient,
    slope_per_um,
    steepest_shift_um,
    threshold_shift_um,
)
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Outline
from microplan.optics.transfer.microscope import Microscope

LEVELS = ("off", "modelled", "charged from sigma", "not modelled")
# Edge finders smooth by at least this, and by the standard deviation of a blur circle.
_SMOOTHING_PX = 0.8
_NM = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LensRow:
    """One effect of the lens on one target.

    Shifts are the largest over the target's points, along `axis`.
    """

    effect: str
    level: str  # one of LEVELS
    axis: str  # "xy" in the plane, "edge" across an edge, "z" of a height by focus
    known_nm: float  # what the known part does, whether modelled or not
    left_nm: float  # what of it stays at this level, systematic
    sigma_nm: float  # one standard deviation of the unknown part, per axis
    reason: str


def predict(
    errors: LensErrors,
    microscope: Microscope,
    points_um: npt.ArrayLike,
    *,
    defocus_um: float = 0.0,
    outline: Outline | None = None,
    levels: tuple[float, float] = (0.0, 1.0),
) -> tuple[LensRow, ...]:
    """Return the shifts of a target by the errors of a lens.

    Images, and what is measured in them, are taken to be of
    `microplan.optics.lens.distorted_scene.lens_scene` with the light's gradient.

    Parameters
    ----------
    microscope : Microscope
        The optical setting in use.
    points_um : (N, 2) float array
        Points of the target, or the corners of its box, from the optical axis, um.
    defocus_um : float
        Height of the target minus that of the plane in focus.
    outline : Outline, optional
        The target's body in the world frame; its centroid and a threshold over all of
        it are predicted, and what one height for all of it leaves out.
    levels : (dark, bright)
        Reflectances on both sides of its edges.

    Returns
    -------
    tuple of LensRow
        Always the same effects in the same order, but for those of the whole body.
        Level `off` where nothing is known or unknown.

    Raises
    ------
    ValueError
        If there is no point, a number is not finite or a point is where the distortion
        folds the image.
    """
    points = np.atleast_2d(np.asarray(points_um, dtype=np.float64))
    displaced(points, errors, microscope, defocus_um=defocus_um)  # refuses what folds
    if points.shape[0] == 0:
        raise ValueError("a target needs at least one point")
    target = _Target(
        microscope=microscope,
        points=points,
        z_um=defocus_um,
        outline=outline,
        levels=levels,
    )
    return (
        _distortion(errors, target),
        _shift(errors, target),
        _scale(errors, target),
        _curvature(errors, target),
        _aperture(errors, target),
        *_light(errors, target),
        _offset(errors),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Target:
    """What is looked at."""

    microscope: Microscope
    points: FloatArray  # (N, 2) um
    z_um: float
    outline: Outline | None
    levels: tuple[float, float]

    @property
    def farthest_um(self) -> float:
        """Return how far the outermost point is from the axis."""
        return float(np.hypot(*self.points.T).max())


def _distortion(errors: LensErrors, target: _Target) -> LensRow:
    r = target.farthest_um
    at_corner = r * (r / corner_um(target.microscope)) ** 2
    return _row(
        "radial distortion",
        abs(errors.distortion) * at_corner,
        errors.distortion_sigma * at_corner,
        f"d r (r / r_corner)**2 at r = {r:.4g} um",
    )


def _shift(errors: LensErrors, target: _Target) -> LensRow:
    z = abs(target.z_um)
    return _row(
        "lateral shift with focus",
        math.hypot(errors.lateral_x, errors.lateral_y) * z,
        errors.lateral_sigma * z,
        f"{z:.4g} um out of focus",
    )


def _scale(errors: LensErrors, target: _Target) -> LensRow:
    lever = target.farthest_um * abs(target.z_um)
    return _row(
        "scale with focus",
        abs(errors.scale_per_um) * lever,
        errors.scale_sigma_per_um * lever,
        f"at {target.farthest_um:.4g} um, {abs(target.z_um):.4g} um out of focus",
    )


def _curvature(errors: LensErrors, target: _Target) -> LensRow:
    sag = target.farthest_um**2 / 2
    rest = 0.0
    if target.outline is not None:
        rest = curvature_rest_um(target.outline, target.microscope, errors)
    return _row(
        "field curvature",
        abs(errors.field_curvature_per_um) * sag,
        errors.field_curvature_sigma_per_um * sag,
        "r**2 / (2 R); one height for the whole body leaves half its range",
        axis="z",
        rest_um=rest,
    )


def _aperture(errors: LensErrors, target: _Target) -> LensRow:
    """Return the row of the aperture: a blur of another width moves no edge."""
    level, reason = "off", "no table of apertures"
    if errors.apertures:
        wanted = errors.aperture_at(target.microscope.magnification)
        used = target.microscope.aperture
        level = "modelled" if math.isclose(wanted, used) else "not modelled"
        reason = f"A = {used:.4g}, by the table {wanted:.4g}; blur is symmetric"
    return LensRow(
        effect="aperture by zoom",
        level=level,
        axis="xy",
        known_nm=0.0,
        left_nm=0.0,
        sigma_nm=0.0,
        reason=reason,
    )


def _light(errors: LensErrors, target: _Target) -> list[LensRow]:
    """Return the rows of the light's gradient, by what is measured."""
    known = (errors.gradient_x, errors.gradient_y)
    sigma = errors.gradient_sigma
    names = {"light gradient, steepest edge": _steepest_um}
    if target.outline is not None:
        names["light gradient, threshold"] = _threshold_um
        names["light gradient, centroid"] = _centroid_um
    rows = []
    for effect, shift_um in names.items():
        off = not (any(known) or sigma)
        shifts = [0.0] * 3
        if not off:
            axes = (known, (sigma, 0.0), (0.0, sigma))
            shifts = [shift_um(target, gradient) for gradient in axes]
        rows.append(_row(effect, shifts[0], max(shifts[1:]), "of this gradient alone"))
    return rows


def _steepest_um(target: _Target, gradient: tuple[float, float]) -> float:
    """Return the largest shift of a steepest edge at the points."""
    optics = target.microscope
    smoothing = max(
        _SMOOTHING_PX * optics.um_per_px, optics.blur_diameter_um(target.z_um) / 4
    )
    each = [
        math.hypot(*relative_gradient(optics, gradient, (x, y)))
        for x, y in target.points.tolist()
    ]
    return steepest_shift_um(max(each), optics, target.z_um, smoothing_um=smoothing)


def _threshold_um(target: _Target, gradient: tuple[float, float]) -> float:
    """Return the largest shift of an edge by one threshold for the whole body."""
    if target.outline is None:
        return 0.0
    x_min, y_min, x_max, y_max = target.outline.bounds_um
    at = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    gx, gy = relative_gradient(target.microscope, gradient, at)
    lever = (abs(gx) * (x_max - x_min) + abs(gy) * (y_max - y_min)) / 2
    slope = slope_per_um(target.microscope, target.z_um)
    return threshold_shift_um(lever, slope, target.levels, lever_um=1.0)


def _centroid_um(target: _Target, gradient: tuple[float, float]) -> float:
    """Return the shift of the body's centroid of light."""
    if target.outline is None:
        return 0.0
    return math.hypot(*centroid_shift_um(target.outline, gradient, target.microscope))


def _offset(errors: LensErrors) -> LensRow:
    return _row(
        "edge offset, made against drawn",
        abs(errors.edge_offset_um),
        errors.edge_offset_sigma_um,
        "of every edge, outwards; opposite edges cancel in a centre",
        axis="edge",
    )


def _row(
    effect: str,
    known_um: float,
    sigma_um: float,
    reason: str,
    *,
    axis: str = "xy",
    rest_um: float = 0.0,
) -> LensRow:
    """Return a row with its level; `rest_um` stays where the effect is modelled."""
    unknown = "charged from sigma" if sigma_um else "off"
    return LensRow(
        effect=effect,
        level="modelled" if known_um else unknown,
        axis=axis,
        known_nm=known_um * _NM,
        left_nm=rest_um * _NM,
        sigma_nm=sigma_um * _NM,
        reason=reason,
    )
