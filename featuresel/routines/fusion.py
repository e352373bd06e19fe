"""Several features of one part, measured on one frame, to the pose of the part."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure

_ROUNDS = 8  # of Gauss-Newton: the turn is all that is not linear
_STILL_RAD = 1e-12
# a spread below it counts as it, as in `microplan.featuresel.sets.pose_covariance`
_FINEST_UM = 1e-4
_FINEST_RAD = 1e-6
_BLIND = 1e-6  # of the largest singular value: an arm of a pm beside a um
_TOLD_RAD = 0.5  # an angle that is known worse is not determined
_DOUBT = 3.72  # normal quantile of 1 - 1e-4: features that agree are refused so rarely


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenFeature:
    """A feature where a frame shows it, world frame."""

    x_um: float
    y_um: float
    sigma_um: float  # of its position per axis
    offset_um: tuple[float, float] = (0.0, 0.0)  # from the wanted point, part's frame
    axis_rad: float | None = None  # the one direction in which the position is known
    theta_rad: float | None = None  # of the part, as this feature has it
    sigma_theta_rad: float | None = None  # of that; None: it is not to be used


@dataclass(frozen=True, slots=True, kw_only=True)
class Believed:
    """A part's angle as it is thought to be."""

    theta_rad: float
    sigma_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Fused:
    """The wanted point and the part's angle, world frame."""

    x_um: float
    y_um: float
    theta_rad: float | None  # None: no feature determines it
    sigma_um: float  # of the position in its worst direction, by the features' own
    sigma_theta_rad: float | None
    chi_square: float  # sum of squared deviations of the features, in their sigmas
    freedom: int  # numbers measured beyond those wanted


def fuse(
    seen: Sequence[SeenFeature], believed: Believed | None = None
) -> Fused | Failure:
    """Return the pose that fits all features best, weighted by their sigmas.

    Parameters
    ----------
    seen : sequence of Seen
        The features.
    believed : Believed, optional
        The part's angle as it is thought to be. It holds where no feature measures an
        angle and their positions determine it worse than that, or worse than
        `_TOLD_RAD`.

    Returns
    -------
    Fused or Failure
        `under_determined` if the features leave the position open, `no_angle` if the
        position depends on an angle that is not known, `features_disagree` if they are
        farther apart than one in 10 000 that agree.

    Notes
    -----
    Least squares in position and angle, J = [u^T, u^T dR/dtheta offset], as in Feddema
    & Simon (1998), eqs. (13, 16), in object space. The bound of chi-square is that of
    Wilson & Hilferty (1931).
    """
    start = _angle(seen, believed)
    rows, _ = _system(seen, start or 0.0)
    if not _tells(rows[:, :2]):
        return Failure("under_determined", "the place is not told")
    free = 3 if _turn_free(seen, rows, believed) else 2
    lever_um = max((math.hypot(*one.offset_um) for one in seen), default=0.0)
    if start is None and free == 2 and lever_um > _FINEST_UM:
        return Failure("no_angle", "features off the point, angle unknown")
    return _settled(seen, start or 0.0, free)


def _settled(
    seen: Sequence[SeenFeature], start_rad: float, free: int
) -> Fused | Failure:
    """Return the fit of the first two or all three of position and angle."""
    pose = np.array([0.0, 0.0, start_rad])
    for _ in range(_ROUNDS):
        rows, off = _system(seen, pose[2], (pose[0], pose[1]))
        step = np.zeros(3)
        step[:free] = np.linalg.lstsq(rows[:, :free], -off, rcond=None)[0]
        pose = pose + step
        if abs(step[2]) < _STILL_RAD:
            break
    rows, off = _system(seen, pose[2], (pose[0], pose[1]))
    freedom, chi_square = len(off) - free, float(off @ off)
    if not chi_square <= bound(freedom):  # also refuses nan
        return Failure(
            "features_disagree",
            f"chi-square {chi_square:.3g}, at most {bound(freedom):.3g}",
        )
    known = _covariance(rows[:, :free])
    return Fused(
        x_um=float(pose[0]),
        y_um=float(pose[1]),
        theta_rad=float(pose[2]) if free == 3 else None,
        sigma_um=math.sqrt(float(np.linalg.eigvalsh(known[:2, :2])[-1])),
        sigma_theta_rad=math.sqrt(float(known[2, 2])) if free == 3 else None,
        chi_square=chi_square,
        freedom=freedom,
    )


def _turn_free(
    seen: Sequence[SeenFeature], rows: FloatArray, believed: Believed | None
) -> bool:
    """Return whether the features determine the angle better than it is believed."""
    if any(s.theta_rad is not None and s.sigma_theta_rad is not None for s in seen):
        return True
    if not _tells(rows):
        return False
    sigma = math.sqrt(float(_covariance(rows)[2, 2]))
    # a look that is repeated determines it as well as before
    limit = _TOLD_RAD if believed is None else min(1.01 * believed.sigma_rad, _TOLD_RAD)
    return sigma <= limit


def bound(freedom: int) -> float:
    """Return what chi-square stays below in all but one of 10 000 cases."""
    if freedom < 1:
        return math.inf  # nothing is determined twice
    part = 2 / (9 * freedom)
    return float(freedom * (1 - part + _DOUBT * math.sqrt(part)) ** 3)


def _angle(seen: Sequence[SeenFeature], believed: Believed | None) -> float | None:
    """Return the angle to start from: the best measured, the one believed, or that of
    the longest line between two features."""
    turns = [
        (s.sigma_theta_rad, s.theta_rad)
        for s in seen
        if s.theta_rad is not None and s.sigma_theta_rad is not None
    ]
    if turns:
        return min(turns)[1]
    if believed is not None:
        return believed.theta_rad
    whole = [s for s in seen if s.axis_rad is None]
    lines = [
        (math.dist(a.offset_um, b.offset_um), _bearing(a, b))
        for k, a in enumerate(whole)
        for b in whole[:k]
    ]
    length, turn = max(lines, default=(0.0, 0.0))
    return turn if length > _FINEST_UM else None


def _bearing(a: SeenFeature, b: SeenFeature) -> float:
    """Return the rotation from the line between two features as drawn to that seen."""
    (ax, ay), (bx, by) = a.offset_um, b.offset_um
    drawn = math.atan2(by - ay, bx - ax)
    seen = math.atan2(b.y_um - a.y_um, b.x_um - a.x_um)
    return math.remainder(seen - drawn, math.tau)


def _system(
    seen: Sequence[SeenFeature],
    theta_rad: float,
    at_um: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian's rows and the deviations, all over the sigmas."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    rows: list[tuple[float, float, float]] = []
    off: list[float] = []
    for one in seen:
        sigma = max(one.sigma_um, _FINEST_UM)
        x, y = one.offset_um
        arm = (c * x - s * y, s * x + c * y)
        axes = (0.0, math.pi / 2) if one.axis_rad is None else (one.axis_rad,)
        for axis in axes:
            u, v = math.cos(axis), math.sin(axis)
            miss = (at_um[0] + arm[0] - one.x_um, at_um[1] + arm[1] - one.y_um)
            rows.append(_scaled((u, v, v * arm[0] - u * arm[1]), sigma))
            off.append((u * miss[0] + v * miss[1]) / sigma)
        if one.theta_rad is not None and one.sigma_theta_rad is not None:
            turned = math.remainder(theta_rad - one.theta_rad, math.tau)
            sigma = max(one.sigma_theta_rad, _FINEST_RAD)
            rows.append(_scaled((0.0, 0.0, 1.0), sigma))
            off.append(turned / sigma)
    jacobian = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return jacobian, np.array(off, dtype=np.float64)


def _scaled(
    row: tuple[float, float, float], sigma: float
) -> tuple[float, float, float]:
    return (row[0] / sigma, row[1] / sigma, row[2] / sigma)


def _tells(rows: FloatArray) -> bool:
    """Return whether the rows determine all columns; rotations are per um of arm."""
    if len(rows) < rows.shape[1]:
        return False
    values = np.linalg.svd(rows, compute_uv=False)
    return bool(values[-1] > _BLIND * values[0])


def _covariance(rows: FloatArray) -> FloatArray:
    """Return the covariance of what the rows tell."""
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    scaled = vectors / values[:, None]
    found: FloatArray = scaled.T @ scaled
    return found
