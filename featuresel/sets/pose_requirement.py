"""How well a pose has to be known, and how well features tell it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    conditioning,
    covariance,
)

CONDITIONING = 50.0  # a set beyond it hardly sees some motion


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseRequirement:
    """What a set has to tell."""

    sigma_um: float  # at most, of the place in the direction known worst
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
    """How well a set tells the pose."""

    covariance: tuple[tuple[float, float, float], ...]  # x, y, um; theta, rad
    sigma_um: float  # of the place in the direction known worst
    sigma_theta_rad: float
    conditioning: float


def known(sights: Sequence[FeatureMeasurement], need: PoseRequirement) -> PoseAccuracy:
    """Return how well the features together tell the pose."""
    found = covariance(sights, need.radius_um)
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
            sights, need.radius_um, angle=need.sigma_theta_rad is not None
        ),
    )


def log_det(sights: Sequence[FeatureMeasurement], need: PoseRequirement) -> float:
    """Return -log det of the covariance of what is wanted, um; -inf if it is blind."""
    wanted = 2 if need.sigma_theta_rad is None else 3
    found = covariance(sights, need.radius_um)[:wanted, :wanted]
    if not np.isfinite(found).all():
        return -math.inf
    return -float(np.linalg.slogdet(found)[1])
