"""Covariance of a part's pose from several features, against what is required."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.trials.score import ChainScore

CONDITIONING = 50.0  # a set beyond it hardly sees some motion


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseRequirement:
    """What a set has to tell."""

    sigma_um: float  # at most, of the position in the direction known worst
    sigma_theta_rad: float | None = None  # None: the angle is not wanted
    radius_um: float  # of the part: scales the rotation
    most: int = 4  # features in a set
    redundant: bool = True  # still good with any one feature dropped
    conditioning: float = CONDITIONING

    def __post_init__(self) -> None:
        theta = 1.0 if self.sigma_theta_rad is None else self.sigma_theta_rad
        if not (self.sigma_um > 0 and theta > 0 and self.radius_um > 0):
            raise ValueError(f"sigmas and radius must be positive, got {self}")
        if self.most < 1 or not self.conditioning >= 1:
            raise ValueError(f"most and conditioning must be >= 1, got {self}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseAccuracy:
    """How well a set determines the pose."""

    covariance: tuple[tuple[float, float, float], ...]  # x, y, um; theta, rad
    sigma_um: float  # of the position in the direction known worst
    sigma_theta_rad: float
    conditioning: float


def known(
    measured: Sequence[FeatureMeasurement], need: PoseRequirement
) -> PoseAccuracy:
    """Return how well the features together determine the pose."""
    found = covariance(measured, need.radius_um)
    place = found[:2, :2]
    worst = math.inf
    if np.isfinite(place).all():
        worst = math.sqrt(float(np.linalg.eigvalsh(place)[-1]))
    angle = np.array([1.0, 1.0, 1 / need.radius_um])
    rows = (found * np.outer(angle, angle)).tolist()
    return PoseAccuracy(
        covariance=tuple((row[0], row[1], row[2]) for row in rows),
        sigma_um=worst,
        sigma_theta_rad=math.sqrt(rows[2][2]),
        conditioning=conditioning(
            measured, need.radius_um, angle=need.sigma_theta_rad is not None
        ),
    )


FINEST_UM = 1e-4  # a spread below it counts as it: less than an atom's width
_BLIND = 1e-6  # of the largest singular value: an arm of .1 nm on a part of 100 um


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureMeasurement:
    """One feature as a routine measures it, in the world's axes."""

    name: str
    x_um: float  # of the feature, seen from the point whose place is wanted
    y_um: float
    sigma_um: float  # of its position per axis, bias included; inf: blind
    axis_rad: float | None = None  # the one direction in which the position is known
    sigma_theta_rad: float | None = None  # of its own angle; None: not measured
    cost: float = 0.0

    def __post_init__(self) -> None:
        theta = 0.0 if self.sigma_theta_rad is None else self.sigma_theta_rad
        if not (self.sigma_um >= 0 and theta >= 0 and self.cost >= 0):  # refuses nan
            raise ValueError(f"spreads and cost must be >= 0, got {self}")
        places = (self.x_um, self.y_um, self.axis_rad or 0.0, self.cost)
        if not all(map(math.isfinite, places)):
            raise ValueError(f"places, axis and cost must be finite, got {self}")


def measurement_of(
    feature: Feature,
    score: ChainScore,
    *,
    about_um: Point,
    theta_rad: float,
    made_um: float = 0.0,
) -> FeatureMeasurement:
    """Return a feature as its trials saw it.

    Parameters
    ----------
    feature : Feature
        In the part's frame.
    score : ChainScore
        Of the chain that measures it, at the feature's own position. A bias that is
        left counts as standard deviation.
    about_um : (x, y)
        The point of the part whose position is wanted, in the part's frame.
    theta_rad : float
        Nominal angle of the part.
    made_um : float
        One sigma per axis of where the part as fabricated has the feature.
    """
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    x, y = feature.center_um[0] - about_um[0], feature.center_um[1] - about_um[1]
    sigma = math.inf
    if score.sigma_um is not None and score.bias_um is not None:
        sigma = math.hypot(score.sigma_um, *score.bias_um, made_um)
    turn = None
    if score.sigma_theta_rad is not None and math.isfinite(score.need_theta_rad):
        turn = math.hypot(score.sigma_theta_rad, score.bias_theta_rad or 0.0)
    axis = score.axis_rad
    return FeatureMeasurement(
        name=feature.name,
        x_um=c * x - s * y,
        y_um=s * x + c * y,
        sigma_um=sigma,
        axis_rad=None if axis is None else axis + theta_rad,
        sigma_theta_rad=turn,
        cost=score.cost,
    )


def jacobian(measured: Sequence[FeatureMeasurement], radius_um: float) -> FloatArray:
    """Return how what is measured moves with the pose, rotation as the rim's way.

    Parameters
    ----------
    measured : sequence of FeatureMeasurement
        A blind one has no rows, one known along an axis has that of its position.
    radius_um : float
        Of the part, > 0.

    Returns
    -------
    (N, 3) float64 array
        Rows in um: positions, and angles times the radius. Columns: x and y, um, and
        the angle times the radius, um.

    Raises
    ------
    ValueError
        If `radius_um` is not positive.

    References
    ----------
    Feddema & Simon (1998), eqs. (13, 16), in object space, with the rotation's column
    (-y, +x).
    """
    return _rows(measured, radius_um)[0]


def information(measured: Sequence[FeatureMeasurement], radius_um: float) -> FloatArray:
    """Return sum J^T R^-1 J, (3, 3), per um2; arguments as in `jacobian`."""
    rows, sigmas = _rows(measured, radius_um)
    weighted = rows / sigmas[:, None]
    found: FloatArray = weighted.T @ weighted
    return found


def conditioning(
    measured: Sequence[FeatureMeasurement], radius_um: float, *, angle: bool
) -> float:
    """Return largest over smallest singular value of the Jacobian, or infinity.

    Parameters
    ----------
    measured : sequence of FeatureMeasurement
        The features.
    radius_um : float
        Of the part, > 0.
    angle : bool
        Whether the angle is wanted; if not, it is taken as known.
    """
    rows = jacobian(measured, radius_um)[:, : 3 if angle else 2]
    values = np.linalg.svd(rows, compute_uv=False)
    if len(values) < rows.shape[1] or values[-1] <= values[0] * _BLIND:
        return math.inf
    return float(values[0] / values[-1])


def controllability(
    measured: Sequence[FeatureMeasurement], radius_um: float, *, angle: bool
) -> tuple[int, float]:
    """Return rank and smallest singular value of the Jacobian, see `conditioning`.

    The value is what is seen, um, of a move of 1 um in the direction seen least.
    """
    rows = jacobian(measured, radius_um)[:, : 3 if angle else 2]
    values = np.linalg.svd(rows, compute_uv=False)
    rank = int(np.count_nonzero(values > _BLIND * max(values, default=0.0)))
    return rank, float(values[-1]) if rank == rows.shape[1] else 0.0


def covariance(measured: Sequence[FeatureMeasurement], radius_um: float) -> FloatArray:
    """Return the pose's covariance (sum J^T R^-1 J)^-1; arguments as in `jacobian`.

    Returns
    -------
    (3, 3) float64 array
        Of x and y, um, and the angle times the radius, um. What is not observable has
        infinite variance and no covariance.
    """
    rows, sigmas = _rows(measured, radius_um)
    if not len(rows):
        return np.diag(np.full(3, math.inf))
    # what is observable at all does not depend on how well
    _, values, vectors = np.linalg.svd(rows)
    rank = int(np.count_nonzero(values > _BLIND * values[0]))
    seen = vectors[:rank].T
    # by singular values, not by squares: those of far apart spreads have no inverse
    _, sizes, ways = np.linalg.svd((rows / sigmas[:, None]) @ seen, full_matrices=False)
    # what rounding hides beside the best that is known counts as known no worse
    axes = seen @ (ways.T / np.maximum(sizes, sizes[0] * np.finfo(np.float64).eps))
    found: FloatArray = axes @ axes.T
    blind = (vectors[rank:] ** 2).sum(axis=0) > _BLIND**2
    found[blind, :] = 0.0
    found[:, blind] = 0.0
    found[blind, blind] = math.inf
    return (found + found.T) / 2


def _rows(
    measured: Sequence[FeatureMeasurement], radius_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian's rows and the standard deviation of each, um."""
    if not radius_um > 0:
        raise ValueError(f"radius_um must be positive, got {radius_um}")
    rows: list[tuple[float, float, float]] = []
    sigmas: list[float] = []
    for one in measured:
        axes = [0.0, math.pi / 2] if one.axis_rad is None else [one.axis_rad]
        for axis in axes if math.isfinite(one.sigma_um) else []:
            c, s = math.cos(axis), math.sin(axis)
            lever = (s * one.x_um - c * one.y_um) / radius_um
            rows.append((c, s, lever))
            sigmas.append(max(one.sigma_um, FINEST_UM))
        turn = one.sigma_theta_rad
        if turn is not None and math.isfinite(turn):
            rows.append((0.0, 0.0, 1.0))
            sigmas.append(max(turn * radius_um, FINEST_UM))
    return np.array(rows).reshape(-1, 3), np.array(sigmas)
