"""Feddema's criteria for image features, as named columns of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.featuresel.features.feature import Feature
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    conditioning,
    controllability,
)
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore


@dataclass(frozen=True, slots=True, kw_only=True)
class Criteria:
    """One candidate, a feature or a set of them, by the criteria of the literature.

    Of the image:

    - `robustness`: the least rate of right answers that the trials do not refute,
      Clopper-Pearson, one-sided; of a set their product, as if they failed apart.
    - `uniqueness`: 1 - a, with a the largest share of the drawn edges that meets itself
      under a wrong rotation of the declared range; 0 where nothing tells two of its
      angles apart; of a set the largest, because one unique feature is enough.
    - `completeness`: share of the drawn edges in view with nothing in front; of a set
      weighted by their length. None where it is not known.
    - `cost`: work of one fix, in 640 x 480 box filters; of a set the sum.

    Of the control, by the Jacobian J of the features with the rotation scaled by the
    part's radius (`microplan.featuresel.sets.pose_covariance`):

    - `resolution_um`: the smallest move that is distinguished from noise, one standard
      deviation of the position in the worse direction, what is left of the bias in it;
      of a set that of sqrt(max eig C), C = (sum J^T R^-1 J)^-1.
    - `rank`, `controllability`: rank of J and its smallest singular value, 0 where a
      wanted direction of the pose is not seen at all.
    - `conditioning`: largest over smallest singular value of J; 1 is best.

    References
    ----------
    Feddema, Lee & Mitchell (1991), "Weighted selection of image features for resolved
    rate visual feedback control", IEEE Trans. Robotics and Automation 7 (1);
    Feddema & Simon (1998). Their robustness and uniqueness are judged by hand; here
    they are measured in trials and on the drawing.
    """

    name: str
    chain: Chain  # of routines; of a set the features' names
    robustness: float
    uniqueness: float
    completeness: float | None
    cost: float
    resolution_um: float
    rank: int
    controllability: float
    conditioning: float


COLUMNS = (
    "robustness", "uniqueness", "completeness", "cost",
    "resolution_um", "rank", "controllability", "conditioning",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A feature with the chain that measures it, as trials saw it."""

    feature: Feature
    score: ChainScore
    measurement: FeatureMeasurement
    seen: (
        float | None
    )  # share of its edges, from `microplan.featuresel.features.feature`


def criteria(
    candidate: Candidate,
    *,
    radius_um: float,
    theta_range_rad: float,
    angle: bool,
) -> Criteria:
    """Return one feature by the criteria.

    Parameters
    ----------
    candidate : Candidate
        The feature.
    radius_um : float
        Of the part, > 0.
    theta_range_rad : float
        The part's angle is within this of nominal; pi = any.
    angle : bool
        Whether the angle is wanted.
    """
    whole = set_criteria(
        [candidate],
        candidate.measurement.sigma_um,
        radius_um=radius_um,
        theta_range_rad=theta_range_rad,
        angle=angle,
    )
    return replace(whole, chain=candidate.score.chain, completeness=candidate.seen)


def set_criteria(
    candidates: Sequence[Candidate],
    sigma_um: float,
    *,
    radius_um: float,
    theta_range_rad: float,
    angle: bool,
) -> Criteria:
    """Return a set of features by the criteria; `sigma_um` is that of its pose.

    Raises
    ------
    ValueError
        If there is no feature.
    """
    if not candidates:
        raise ValueError("a set needs at least one feature")
    measured = [c.measurement for c in candidates]
    rank, least = controllability(measured, radius_um, angle=angle)
    return Criteria(
        name=" + ".join(c.feature.name for c in candidates),
        chain=tuple(c.feature.name for c in candidates),
        robustness=math.prod(c.score.success_lower for c in candidates),
        uniqueness=max(
            uniqueness(c.feature, theta_range_rad, angle=angle) for c in candidates
        ),
        completeness=_weighted(candidates),
        cost=sum(c.score.cost for c in candidates),
        resolution_um=sigma_um,
        rank=rank,
        controllability=least,
        conditioning=conditioning(measured, radius_um, angle=angle),
    )


def uniqueness(feature: Feature, theta_range_rad: float, *, angle: bool) -> float:
    """Return 1 - the share of its edges that meets itself under a wrong rotation.

    A rotation beyond the range is no wrong answer, because it is not looked for.
    Without a wanted angle no rotation is wrong.
    """
    if not angle:
        return 1.0
    # both the truth and the wrong answer may be off by the range
    apart_rad = 2 * theta_range_rad
    if feature.period_rad <= min(apart_rad, math.pi):
        return 0.0
    return 1.0 if feature.alike_rad > apart_rad else 1.0 - feature.alike


def _weighted(candidates: Sequence[Candidate]) -> float | None:
    """Return the mean of what is seen, by the length of edges."""
    known = [(c.seen, c.feature.edge_um) for c in candidates if c.seen is not None]
    if len(known) < len(candidates):
        return None
    return sum(s * w for s, w in known) / sum(w for _, w in known)
