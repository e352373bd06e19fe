"""Mean profile of light across the edges of a part in a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour.polarity import place, profiles
from microplan.featuresel.routines.sampling import STEP_PX
from microplan.planner.calibration.geometry.drawn_edges import edge_offsets

HALF_PX = 8.0  # of a profile; what lies beyond images have as pictures do
_NEAR_PX = 1.0  # from the usual place: else it is another edge, or turned
_ROUNDS = 3  # of moving the contour onto the picture's edges
_FEWEST = 40  # points


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgePoints:
    """Points on the edges of a part."""

    case: LookCase
    theta_rad: float  # of the target in the picture
    kept: BoolArray  # (N,) of its contour

    def where(self, at_px: tuple[float, float]) -> FloatArray:
        """Return points (M, 4), px: column, row, normal, of a part at a place."""
        points = np.array(self.case.target.contour, dtype=np.float64).reshape(-1, 4)
        target = replace(
            self.case.target, column=at_px[0], row=at_px[1], theta_rad=self.theta_rad
        )
        return place(points[self.kept], target)


def across_px() -> FloatArray:
    """Return where a profile's values lie, (L,) px outwards from the edge."""
    count = math.ceil(HALF_PX / STEP_PX)
    return np.asarray(np.arange(-count, count + 1) * STEP_PX, dtype=np.float64)


def points_seen(
    case: LookCase, shown: FloatArray, at_px: tuple[float, float], theta_rad: float
) -> EdgePoints | None:
    """Return the contour points whose edges a sharp picture shows; None: too few.

    Parameters
    ----------
    case : LookCase
        Of the region that is shown.
    shown : (rows, columns) float array
        Its light, 0..1.
    at_px : (column, row)
        Where the target is.
    theta_rad : float
        Its angle, counter-clockwise.
    """
    every = np.ones(len(case.target.contour), dtype=np.bool_)
    points = EdgePoints(case=case, theta_rad=theta_rad, kept=every)
    edges, good = edge_offsets(profiles(shown, points.where(at_px), HALF_PX / 2))
    if not good.any():
        return None
    good &= np.abs(edges - np.median(edges[good])) < _NEAR_PX
    return replace(points, kept=good) if good.sum() >= _FEWEST else None


def mean_profile(
    points: EdgePoints, shown: FloatArray, at_px: tuple[float, float]
) -> FloatArray | None:
    """Return the mean light across edges, (L,) from inside outwards; None: not seen.

    The part is moved first to where its edges are; `at_px` is about there.
    """
    at = np.array(at_px)
    for _ in range(_ROUNDS):
        where = points.where((float(at[0]), float(at[1])))
        edges, good = edge_offsets(profiles(shown, where, HALF_PX))
        if good.sum() < _FEWEST:
            return None
        design = np.column_stack([where[good, 2:], np.ones(int(good.sum()))])
        at = at + np.linalg.lstsq(design, edges[good], rcond=1e-9)[0][:2]
    return plain_profile(points, shown, (float(at[0]), float(at[1])))


def plain_profile(
    points: EdgePoints, shown: FloatArray, at_px: tuple[float, float]
) -> FloatArray | None:
    """Return the mean light across edges, (L,), of a part at a place; None: outside."""
    values = profiles(shown, points.where(at_px), HALF_PX)
    whole = np.isfinite(values).all(axis=1)
    if whole.sum() < _FEWEST:
        return None
    return np.asarray(values[whole].mean(axis=0))
