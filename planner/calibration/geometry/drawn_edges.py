"""Edges of a part in a picture against its drawing: scale, skew, offset."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour.polarity import place, profiles
from microplan.featuresel.routines.sampling import STEP_PX
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.geometry.affine_scale import stretch_of

_LEAST_PX, _AIRY = 4.0, 2.0  # half a profile: so much, and so many Airy radii
_ALONE = 0.9  # of half a profile: no other edge comes nearer to its ends
_PLATEAU = 0.3  # of half a profile at either end: faces without the edge's blur
_FAINT = 0.3  # of the usual step: less is a shadow or another edge
_OUTLIER = 4.0  # standard deviations
_FEWEST = 40  # points
_ROUNDS = 3  # of placing and measuring: the second is within .01 px
_WORST = 6.0  # times that scales err more because the offset is not known
# px, by which edges at either end of a part differ between two exact images of it: as
# much as pictures of twins and the compiler's images do
TRUE_PX = 0.001
_NEVER = 1e-6  # share of the largest singular value: scale and offset are one


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnScale:
    """How a picture has a part, against its drawing."""

    stretch: FloatArray  # (2, 2) px/um, symmetric: right and up over the world's x, y
    offset_px: float  # of edges seen, outwards from those drawn
    offset_apart: bool  # False: one convex outline, whose size may be offset or scale
    reach_px: float  # from the part's place to its farthest edge


def half_profile_px(scope: Microscope) -> float:
    """Return how far along the normals a profile reaches, px."""
    return max(_LEAST_PX, _AIRY * scope.airy_radius_um * scope.px_per_um)


def lone_points(case: LookCase) -> BoolArray:
    """Return which contour points have no other edge near their profiles, (N,)."""
    points = np.array(case.target.contour, dtype=np.float64).reshape(-1, 4)
    half_um = half_profile_px(case.microscope) / case.target.px_per_um
    tree = cKDTree(points[:, :2])
    kept = np.ones(len(points), dtype=np.bool_)
    for side in (-half_um, half_um):
        near, _ = tree.query(points[:, :2] + side * points[:, 2:])
        kept &= near >= _ALONE * half_um
    return kept


def drawn_scale(
    case: LookCase,
    shown: FloatArray,
    meant: FloatArray,
    at_px: tuple[float, float],
    theta_rad: float,
    lone: BoolArray,
) -> DrawnScale | None:
    """Return the scale of a part's edges in a picture; None if they do not show it.

    Parameters
    ----------
    case : LookCase
        Of the region that is shown.
    shown : (rows, columns) float array
        Its light, 0..1.
    meant : (rows, columns) float array
        The image of the part there: what the lens does to its edges is taken off.
    at_px : (column, row)
        Where the target is in it.
    theta_rad : float
        Its angle, counter-clockwise.
    lone : (N,) bool array
        Points of its contour to use.
    """
    points = np.array(case.target.contour, dtype=np.float64).reshape(-1, 4)[lone]
    target = replace(case.target, column=at_px[0], row=at_px[1], theta_rad=theta_rad)
    half_px = half_profile_px(case.microscope)
    where, middle = place(points, target), np.array(at_px)
    usual, known = edge_offsets(profiles(meant, where, half_px))
    stretch, shift, found = np.eye(2), np.zeros(2), None
    for _ in range(_ROUNDS):
        moved = where.copy()
        moved[:, :2] = middle + (where[:, :2] - middle) @ stretch.T + shift
        edges, good = edge_offsets(profiles(shown, moved, half_px))
        good &= known
        if good.sum() < _FEWEST:
            return None
        found = _fitted(moved[good], (edges - usual)[good], middle + shift)
        if found is None:
            return None
        step, by = found[:4].reshape(2, 2), found[4:6]
        stretch, shift = stretch + step @ stretch, shift + by
    reach_px = float(np.abs(where[:, :2] - middle).max())
    return _scale_of(target.px_per_um * stretch, found, reach_px)


def _scale_of(
    matrix: FloatArray, numbers: FloatArray | None, reach_px: float
) -> DrawnScale | None:
    """Return what a fit says, of (2, 2) px/um along columns and rows."""
    if numbers is None:
        return None
    flip = np.diag([1.0, -1.0])  # rows go down
    return DrawnScale(
        stretch=stretch_of(flip @ matrix @ flip),
        offset_px=float(numbers[6]),
        offset_apart=bool(numbers[7] < _WORST),
        reach_px=reach_px,
    )


def edge_offsets(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return where edges lie in profiles (N, L) of light, px outwards, and which do.

    The edge is where a sharp one would leave as much light: a blur that is symmetric
    moves it nowhere.
    """
    count = values.shape[1]
    ends = max(round(_PLATEAU * count / 2), 1)
    inside, outside = values[:, :ends].mean(axis=1), values[:, -ends:].mean(axis=1)
    step = inside - outside
    whole = np.isfinite(values).all(axis=1)
    usual = np.median(step[whole]) if whole.any() else 0.0
    good = whole & (step * np.sign(usual) > _FAINT * abs(usual)) & (usual != 0)
    safe = np.where(good, step, 1.0)
    share = (values - outside[:, None]) / safe[:, None]
    length = np.sum((share[:, 1:] + share[:, :-1]) / 2, axis=1) * STEP_PX
    offsets: FloatArray = np.where(good, length - (count - 1) / 2 * STEP_PX, 0.0)
    return offsets, np.asarray(good)


def _fitted(
    where: FloatArray, edges: FloatArray, middle: FloatArray
) -> FloatArray | None:
    """Return stretch (4), shift (2) px, offset px, and how both scales mix, (8,).

    Edges (N,) px along normals of points (N, 4) px; outliers are left out.
    """
    right, down = (where[:, :2] - middle).T
    across, along = where[:, 2:].T
    reach = max(float(np.abs(where[:, :2] - middle).max()), 1.0)
    columns = (across * right, across * down, along * right, along * down)
    design = np.column_stack(
        [*(column / reach for column in columns), across, along, np.ones(len(edges))]
    )
    use = np.ones(len(edges), dtype=np.bool_)
    for _ in range(_ROUNDS):
        numbers = np.linalg.lstsq(design[use], edges[use], rcond=1e-9)[0]
        off = edges - design @ numbers
        usual = 1.4826 * float(np.median(np.abs(off[use])))
        use = np.abs(off) <= _OUTLIER * max(usual, 1e-6)
        if use.sum() < _FEWEST:
            return None
    mixed = _mixing(design[use])
    return np.concatenate([numbers[:4] / reach, numbers[4:], [mixed]])


def _mixing(design: FloatArray) -> float:
    """Return how much more scales err because the offset is not known; inf if all.

    Of a design (N, 7) whose first and fourth columns are the scales', the last the
    offset's.
    """
    turn = np.array([[0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]])  # no matter of scale
    design = np.concatenate([design, turn])
    weak = np.linalg.svd(design, compute_uv=False)
    if weak[-1] < _NEVER * weak[0]:
        return math.inf
    both = np.diag(np.linalg.inv(design.T @ design))
    alone = np.diag(np.linalg.inv(design[:, :6].T @ design[:, :6]))
    return float(np.sqrt(both[[0, 3]] / alone[[0, 3]]).max())
