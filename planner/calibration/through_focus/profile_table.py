"""Profiles across a part's edges as the compiler's images have them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.interpolate import CubicSpline

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.sampling import Sampling
from microplan.planner.calibration.through_focus.edge_profile import (
    EdgePoints,
    across_px,
    plain_profile,
)

_SHARES = (0.7, 0.8, 0.9, 1.0, 1.12, 1.3)  # of an aperture about right: columns
_STEEPEST = 0.99  # of the medium's index: no lens is wider
_APART = 0.97  # of the last column, at most, the one before it
_NEAR = 0.02  # of the middle: a spline's error there is small against 1e-4 of a step
_PER_DEPTH = 4.0  # rows in a depth of field
_FEWEST, _MOST = 7, 25  # rows


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileTable:
    """Profiles over defocus and aperture, (L,) each."""

    most_um: float  # defocus
    apertures: FloatArray  # (A,)
    by_defocus: CubicSpline  # (A, L) profiles

    @classmethod
    def of(
        cls, defocus_um: FloatArray, apertures: FloatArray, profiles: FloatArray
    ) -> Self:
        """Return the table through profiles (Z, A, L) at defocus (Z,) from 0.

        They are even in the defocus, so flat at 0.
        """
        flat: Any = ((1, np.zeros(profiles.shape[1:])), "not-a-knot")
        return cls(
            most_um=float(defocus_um[-1]),
            apertures=apertures,
            by_defocus=CubicSpline(defocus_um, profiles, axis=0, bc_type=flat),
        )

    def __call__(self, defocus_um: float, aperture: float) -> FloatArray:
        """Return the profile (L,) at a defocus of either sign; held at the ends."""
        z_um = min(abs(defocus_um), self.most_um)
        a = min(max(aperture, float(self.apertures[0])), float(self.apertures[-1]))
        profiles = self.by_defocus(z_um)
        return np.asarray(CubicSpline(self.apertures, profiles, axis=0)(a))

    @property
    def ends(self) -> tuple[float, float]:
        """Return the smallest aperture and the largest."""
        return float(self.apertures[0]), float(self.apertures[-1])

    @property
    def middle(self) -> float:
        """Return the aperture about which the columns lie."""
        return float(self.apertures[_SHARES.index(1.0)])

    def holds(self, most_um: float, aperture: float) -> bool:
        """Return whether a defocus is inside, an aperture near the middle.

        Between columns profiles err; at the ends they no longer change, and suit as
        well as those beyond.
        """
        near = abs(aperture - self.middle) < _NEAR * self.middle
        return near and most_um < self.most_um


def profile_table(
    points: EdgePoints,
    pose: tuple[float, float, float],
    most_um: float,
    aperture: float,
) -> ProfileTable | None:
    """Return the profiles of a part's edges in images through focus.

    Parameters
    ----------
    points : EdgePoints
        Of the look.
    pose : (x, y, theta)
        Of the target, um and rad from nominal.
    most_um : float
        Largest defocus.
    aperture : float
        About that of the lens, in the middle of the table.
    """
    scope = replace(points.case.microscope, aperture=aperture)
    count = math.ceil(_PER_DEPTH * most_um / scope.wave_depth_um)
    defocus = np.linspace(0, most_um, min(max(count, _FEWEST), _MOST))
    apertures = columns(aperture, scope.medium_index)
    rows = []
    for z_um in defocus.tolist():
        row = [_profile(points, pose, z_um, each) for each in apertures.tolist()]
        if any(each is None for each in row):
            return None
        rows.append([each for each in row if each is not None])
    return ProfileTable.of(defocus, apertures, np.array(rows))


def columns(aperture: float, index: float) -> FloatArray:
    """Return apertures about one in a medium, rising, (A,)."""
    most = _STEEPEST * index
    found = np.array(_SHARES) * min(aperture, most)
    inside = found[found < _APART * most]
    return np.append(inside, most) if found[-1] > most else found


def _profile(
    points: EdgePoints, pose: tuple[float, float, float], z_um: float, aperture: float
) -> FloatArray | None:
    """Return the profile in one image, (L,)."""
    case: LookCase = points.case
    # profiles are even in the defocus, as through a lens without wavefront error
    scope = replace(case.microscope, aperture=aperture, wavefront=())
    seen = replace(case, microscope=scope, model="exact", sampling=Sampling())
    x_um, y_um, turn = pose
    image = nominal_render(seen)(dx_um=x_um, dy_um=y_um, theta_rad=turn, dz_um=z_um)
    at_px = case.frame.to_pixel(case.x_um + x_um, case.y_um + y_um)
    found = plain_profile(points, image, at_px)
    if found is None or len(found) != len(across_px()):
        return None
    return found
