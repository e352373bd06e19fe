"""Contrast of a feature out of focus, up to where its pattern changes sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import map_coordinates

from microplan.arrays import FloatArray
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase

SAFE = 0.8  # of the spurious-resolution limit: how far teeth are taken at their word
# Blur diameter x frequency where geometrical optics has the first zero of a plane
# grating, 2 J1(pi t) = 0; a ring of teeth has its own near it.
_GRATING = 1.22
_SCANNED = 2.0  # times that
_STEPS = 24
_NOTHING = 1e-9  # of full scale, what rounding leaves of a pattern
_AT_ONCE = 8  # images in memory


def contrast(case: LookCase, z_um: Sequence[float]) -> FloatArray:
    """Return the contrast of the target's own pattern, over that in focus.

    Parameters
    ----------
    case : LookCase
        The look; its target is taken alone.
    z_um : (K,) sequence of float
        Defocus of the target's top face.

    Returns
    -------
    (K,) float64 array
        Of teeth the harmonic of their number on the circle midway between tips and
        roots; negative where dark and bright have changed places. Of all else the mean
        slope of the light across the target's drawn edges. 0 at any focus if there is
        none in focus.

    Raises
    ------
    ValueError
        If the target has no drawn edges.
    """
    found = _pattern(case, (0.0, *z_um))
    if abs(found[0]) < _NOTHING:
        return np.zeros(len(z_um))
    share: FloatArray = found[1:] / found[0]
    return share


def spurious_um(case: LookCase) -> float:
    """Return the least defocus at which the target's pattern changes its sign, um.

    Beyond it teeth are seen where the gaps are; stay below `SAFE` of it. The contrast
    is followed through the case's own renderer to twice the defocus at which a
    plane grating of the teeth's pitch vanishes in geometrical optics. inf if it does
    not change its sign there, and of targets without a period, as light spreads but
    never turns negative.
    """
    if case.target.kind != "teeth":
        return math.inf
    scope, ring = case.microscope, case.target.parameters
    pitch = math.pi * (ring["outer_um"] + ring["root_um"]) / ring["count"]
    farthest = _SCANNED * _GRATING * pitch / scope.blur_diameter_um(1.0)
    places = np.linspace(0, farthest, _STEPS + 1)
    for k in range(0, _STEPS, _AT_ONCE):
        values = contrast(case, places[k : k + _AT_ONCE + 1].tolist())
        if (values < 0).any():
            turned = k + int(np.flatnonzero(values < 0)[0])
            fine = np.linspace(places[turned - 1], places[turned], 5)
            return _zero(fine, contrast(case, fine.tolist()))
    return math.inf


def _zero(places: FloatArray, values: FloatArray) -> float:
    """Return where values first change from positive to negative."""
    k = int(np.flatnonzero(values < 0)[0])
    share = values[k - 1] / (values[k - 1] - values[k])
    return float(places[k - 1] + share * (places[k] - places[k - 1]))


def _pattern(case: LookCase, z_um: Sequence[float]) -> FloatArray:
    """Return the strength of the target's pattern, (K,), of full scale."""
    if case.target.kind == "teeth":
        points, weight = _ring(case)
    else:
        points, weight = _across(case)
    top_um = max(layer.z_um for layer in case.moving)
    focused = replace(case, focus_um=top_um, static=())
    dz_um = [-z for z in z_um]  # a lower focus leaves the target higher
    strengths = [
        _seen(focused, points, dz_um[k : k + _AT_ONCE]) @ weight
        for k in range(0, len(dz_um), _AT_ONCE)
    ]
    strength: FloatArray = np.concatenate(strengths) / np.abs(weight).sum()
    return strength


def _ring(case: LookCase) -> tuple[FloatArray, FloatArray]:
    """Return points (N, 2) um on the circle amid the teeth, and their weights."""
    ring = case.target.parameters
    count, radius = int(ring["count"]), (ring["outer_um"] + ring["root_um"]) / 2
    # so many that no harmonic below the cutoff folds onto the teeth's
    finest = 2 * math.pi * radius * case.microscope.cutoff_per_um
    total = count * (math.ceil(finest / count) + 2)
    angles = np.arange(total) * (2 * np.pi / total)
    points = radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return points, np.cos(count * (angles - ring["phase_rad"]))


def _across(case: LookCase) -> tuple[FloatArray, FloatArray]:
    """Return points (N, 2) um in pairs across the drawn edges, and their weights."""
    target = case.target
    if not target.contour:
        target = with_contour(target, [layer.outline for layer in case.moving])
    edges = np.array(target.contour)
    if not edges.size:
        raise ValueError(f"target {target.name!r} has no drawn edges")
    step = case.microscope.wavelength_um / case.microscope.aperture / 8
    places, normals = edges[:, :2], step * edges[:, 2:]
    points = np.concatenate((places - normals, places + normals))
    weight = np.repeat([1.0, -1.0], len(edges))
    return points, weight


def _seen(case: LookCase, points: FloatArray, dz_um: Sequence[float]) -> FloatArray:
    """Return the target alone at each focus, at points of its frame, (K, N).

    Read by cubics from four samples a wavelength / A or more: the finest detail has
    two.
    """
    scope, target = case.microscope, case.target
    fine = scope.wavelength_um / (4 * scope.aperture)
    over = max(1, 2 * math.ceil((scope.um_per_px / fine - 1) / 2) + 1)
    half = math.ceil(float(np.hypot(*points.T).max()) * scope.px_per_um) + 3
    images = nominal_render(case).template(dz_um, over=over, half_px=(half, half))
    cos, sin = math.cos(case.theta_rad), math.sin(case.theta_rad)
    x, y = np.array([[cos, -sin], [sin, cos]]) @ points.T
    columns = target.column - round(target.column) + x * scope.px_per_um
    rows = target.row - round(target.row) - y * scope.px_per_um
    at = over * (np.stack((rows, columns)) + half)
    return np.stack([np.asarray(map_coordinates(i, at, order=3)) for i in images])
