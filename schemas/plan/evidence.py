"""Evidence of trials: of chains, of features by criteria, of several together."""

from __future__ import annotations

from dataclasses import dataclass

from microplan.schemas.plan.measures import ModelCost, Repeatability


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What the trials said of one chain."""

    chain: tuple[str, ...]  # routines, coarse to fine
    trials: int  # how many were tried
    success: int  # how many answered rightly
    success_lower: float  # one-sided 95 %, Clopper-Pearson
    silent: int  # answered, but wrong
    silent_upper: float  # one-sided 95 %, Clopper-Pearson
    bias_um: tuple[float, float] | None  # None: no success to measure it on
    sigma_um: float | None  # per axis
    worst_um: float | None  # largest error, wrong answers included
    sigma_theta_rad: float | None  # of the angle; None: not measured
    cost: float  # deterministic, in 640 x 480 box filters
    reason: str  # why it was chosen, kept as fallback, or rejected
    sigma_upper_um: float | None = None  # of the larger axis, one-sided 95 %
    ratio_to_limit: float | None = None  # rms, bias included, over `limit_xy_um`
    # of the answers; `microplan render --trial` shows it
    worst_trial: int | None = None
    median_trial: int | None = None  # of the answers
    first_failing_trial: int | None = None  # reported or silent


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureRow:
    """One feature, or the set that is used, by Feddema's criteria.

    `docs/features.md` says how each is computed; None where it was not.
    """

    name: str  # features of a set joined by " + "
    kind: str  # of target; "set"
    reason: str  # why it is used or not
    chain: tuple[str, ...] = ()  # the best one, () if none was tried
    robustness: float | None = None  # rate of right answers, lower bound
    # 1 - most edges that meet themselves under a wrong turn
    uniqueness: float | None = None
    # share of the edges in view with nothing in front
    completeness: float | None = None
    cost: float | None = None  # of its chain, in 640 x 480 box filters
    # spread of its place in the direction known worst
    resolution_um: float | None = None
    rank: int | None = None  # of the scaled Jacobian
    # smallest singular value of the scaled Jacobian
    controllability: float | None = None
    conditioning: float | None = None  # largest over smallest singular value; 1 is best


@dataclass(frozen=True, slots=True, kw_only=True)
class FallbackRecord:
    """What the fallback adds to its chain, on the trials that both had."""

    principle: str  # the chain's: edges or area
    other_principle: str  # the fallback's; "" if there is none
    trials: int  # that both had
    chain_failed: int  # gave no right answer
    both_failed: int  # nor did the fallback
    both_failed_upper: float  # rate of that, one-sided 95 %, Clopper-Pearson
    lack: str  # what it costs that none is of another principle; "" if one is


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The trials behind a look's choice; `scores` hold every chain tried."""

    tolerance_um: float  # what the look had to meet
    chosen: Score  # the chain that is used
    others: tuple[Score, ...]  # all other chains that were tried
    features: tuple[FeatureRow, ...] = ()  # the part's, tried or not
    fallback: FallbackRecord | None = None  # None: written by an earlier version


@dataclass(frozen=True, slots=True, kw_only=True)
class Together:
    """What several features of one look tell, measured on the same frame."""

    sigma_xy_um: float  # of the target's place, in the direction known worst
    sigma_theta_rad: float | None  # None: the angle is not told
    conditioning: float  # of the Jacobian, rotation scaled by the part's radius
    dropped_um: float | None  # sigma without the worst feature; None: not told then
    least: int  # features that must answer
    success_lower: float  # of fresh trials of the set, as in `Score`
    silent_upper: float  # as in `Score`, of the same trials
    # Added after 2.3; None: unknown. Of the set's place.
    repeatability: Repeatability | None = None
    model_cost: ModelCost | None = None  # added after 2.4: of the set's place, at most
