"""Outcomes of trials to a score per chain, with confidence bounds."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Failure, Principle
from microplan.featuresel.routines.registry import load
from microplan.featuresel.trials.bounds import (
    CONFIDENCE,
    Estimate,
    estimate,
    failure_upper,
    success_lower,
)
from microplan.featuresel.trials.calibration import SigmaCalibration, calibrate
from microplan.featuresel.trials.chains import Chain, principle
from microplan.featuresel.trials.outcomes import Outcome, Outcomes, PlaceErrors, given
from microplan.featuresel.trials.trials import PreparedRoutines, is_wrong

_TOGETHER = 4  # sigma and mean of two axes: their bounds hold all at once


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainScore:
    """What the trials said of one chain.

    Counts are of all trials, means and standard deviations of the random ones that were
    successes: what is drawn as the workcell states it. Corners are in none of them.
    Axes are those of the target's frame. Where the position is known in one direction
    only, `x` and `y` are None, `along` has that direction, and so do the bias, its
    length along it, and sigma.
    """

    chain: Chain
    principle: Principle = "area"  # of the routine that gives the position
    trials: int
    success: int  # answered, and not wrong
    success_lower: float  # Clopper-Pearson, one-sided 95 %
    silent: int  # answered, but wrong
    silent_upper: float  # Clopper-Pearson, one-sided 95 %
    failures: tuple[tuple[str, int], ...]  # code and count, by code
    bias_um: tuple[float, float] | None  # mean error in the target's frame
    sigma_um: float | None  # about the bias, the larger axis
    worst_um: float | None  # length of the largest error, wrong answers included
    angles: int  # successes that gave an angle, of all trials
    bias_theta_rad: float | None
    sigma_theta_rad: float | None
    cost: float  # of one fix, in 640 x 480 box filters
    x: Estimate | None = None  # um; bounds of x and y hold together
    y: Estimate | None = None
    along: Estimate | None = None
    theta: Estimate | None = None  # rad
    z: Estimate | None = None  # um, of the defocus, or of its size alone
    zoom: Estimate | None = None  # of the ratio to nominal
    axis_rad: float | None = None  # the one direction known, in the target's frame
    # of the chain's own standard deviation; along x where that is the one direction
    spread_x: SigmaCalibration | None = None
    spread_y: SigmaCalibration | None = None
    spread_theta: SigmaCalibration | None = None
    worst_trial: int | None = None  # of the answers by distance: see `design.rebuild`
    median_trial: int | None = None
    first_failing: int | None = None  # with a failure, or without
    limit_um: float | None = None  # Cramer-Rao, the larger axis, if it was computed

    @property
    def need_um(self) -> float:
        """Return 2 sigma + |bias|, what a tolerance must hold; inf without success."""
        if self.bias_um is None or self.sigma_um is None:
            return math.inf
        return 2 * self.sigma_um + math.hypot(*self.bias_um)

    @property
    def need_lower_um(self) -> float:
        """Return the least need that is not refuted; 0 where nothing is known."""
        axes = self._axes
        bias = [max(0.0, abs(a.mean) - a.mean_reach) for a in axes]
        return 2 * max((a.sigma_lower for a in axes), default=0.0) + math.hypot(*bias)

    @property
    def need_upper_um(self) -> float:
        """Return the largest need that is not refuted; inf where nothing is known."""
        axes = self._axes
        if not axes:
            return math.inf
        bias = [abs(a.mean) + a.mean_reach for a in axes]
        return 2 * max(a.sigma_upper for a in axes) + math.hypot(*bias)

    @property
    def need_theta_rad(self) -> float:
        """Return 2 sigma + |bias| of the angle; inf where it is not always given."""
        if self.bias_theta_rad is None or self.sigma_theta_rad is None:
            return math.inf
        if self.angles < self.success:
            return math.inf
        return 2 * self.sigma_theta_rad + abs(self.bias_theta_rad)

    @property
    def rms_um(self) -> float | None:
        """Return the root mean square error of the worse axis, bias included."""
        squares = [a.mean**2 + a.sigma**2 * (1 - 1 / a.count) for a in self._axes]
        return math.sqrt(max(squares)) if squares else None

    @property
    def ratio(self) -> float | None:
        """Return `rms_um` over the Cramer-Rao limit, None where that is not known."""
        rms = self.rms_um
        return rms / self.limit_um if rms is not None and self.limit_um else None

    @property
    def _axes(self) -> list[Estimate]:
        return [a for a in (self.x, self.y, self.along) if a is not None]


def score(
    case: LookCase,
    prepared: PreparedRoutines,
    outcomes: Sequence[Outcome],
    *,
    interim_tests: int = 1,
    limit_um: float | None = None,
) -> tuple[ChainScore, ...]:
    """Return one score per chain, in the order of `prepared.chains`.

    A success is an answer within `WRONG_TOLERANCES` tolerances (place, and angle where
    it is needed and given); a silent failure is any other answer.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        Its chains; each must have an outcome.
    outcomes : sequence of Outcome
        Of trials; chains may have different numbers of them.
    interim_tests : int
        How often the number of trials was decided upon by looking at outcomes. The
        bounds are widened to hold at all of these times at once (union bound).
    limit_um : float, optional
        Cramer-Rao limit of the worse axis.

    Raises
    ------
    ValueError
        If a chain has no outcome, or `interim_tests` is below 1.
    """
    if interim_tests < 1:
        raise ValueError(f"interim_tests must be at least 1, got {interim_tests}")
    whole = Outcomes.of(outcomes)
    scores = [
        score_chain(
            case,
            chain,
            whole.by(chain),
            chain_cost(case, prepared, chain),
            confidence=1 - (1 - CONFIDENCE) / interim_tests,
            limit_um=limit_um,
        )
        for chain in prepared.chains
    ]
    return tuple(replace(each, principle=principle(each.chain)) for each in scores)


def chain_cost(case: LookCase, prepared: PreparedRoutines, chain: Chain) -> float:
    """Return the predicted work of one fix, in 640 x 480 box filters.

    A routine that could not be prepared costs nothing: it never runs.
    """
    pixels, total = case.window.rows * case.window.columns, 0.0
    for name in chain:
        artifact = prepared.artifacts[name]
        if not isinstance(artifact, Failure):
            total += load(name).cost(artifact, pixels)
    return total


def score_chain(
    case: LookCase,
    chain: Chain,
    outcomes: Sequence[Outcome],
    cost: float,
    *,
    confidence: float = CONFIDENCE,
    limit_um: float | None = None,
) -> ChainScore:
    """Return the score of one chain, or of a set of features, by its own outcomes."""
    codes = Counter(o.failure for o in outcomes if o.failure is not None)
    far = sorted((o.distance_um, o.trial) for o in outcomes if o.failure is None)
    right = Outcomes.of(outcomes).only(
        lambda o: o.failure is None and not is_wrong(case, o)
    )
    silent = len(far) - len(right)
    good = {o.trial for o in right}
    drawn = right.only(lambda o: not o.corner)
    parts = PlaceErrors.of(drawn, 1 - (1 - confidence) / _TOGETHER)
    theta = estimate(_turns(drawn), confidence)
    return ChainScore(
        chain=chain,
        trials=len(outcomes),
        success=len(right),
        success_lower=success_lower(len(right), len(outcomes), confidence),
        silent=silent,
        silent_upper=failure_upper(silent, len(outcomes), confidence),
        failures=tuple(sorted(codes.items())),
        bias_um=parts.bias_um,
        sigma_um=parts.sigma_um,
        worst_um=far[-1][0] if far else None,
        angles=len(_turns(right)),
        bias_theta_rad=theta.mean if theta else None,
        sigma_theta_rad=theta.sigma if theta else None,
        cost=cost,
        x=parts.x,
        y=parts.y,
        along=parts.along,
        theta=theta,
        z=estimate(given([o.z_um for o in drawn]), confidence),
        zoom=estimate(given([o.zoom for o in drawn]), confidence),
        axis_rad=parts.axis_rad,
        spread_x=parts.spread_x,
        spread_y=parts.spread_y,
        spread_theta=_theta_spread(drawn),
        worst_trial=far[-1][1] if far else None,
        median_trial=far[(len(far) - 1) // 2][1] if far else None,
        first_failing=min(
            (o.trial for o in outcomes if o.trial not in good), default=None
        ),
        limit_um=limit_um,
    )


def _turns(right: Sequence[Outcome]) -> FloatArray:
    """Return the errors of the angles that were given."""
    return given([o.theta_rad for o in right])


def _theta_spread(right: Sequence[Outcome]) -> SigmaCalibration | None:
    """Return the calibration of the angle; 1 rad stands for a spread not given."""
    claims = [
        (o.theta_rad, 1.0 if o.spread_theta_rad is None else o.spread_theta_rad)
        for o in right
        if o.theta_rad is not None
    ]
    turns, spreads = np.array(claims, dtype=np.float64).reshape(-1, 2).T
    return calibrate(turns, spreads)
