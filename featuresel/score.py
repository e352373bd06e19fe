"""Outcomes of trials to a score per chain, with confidence bounds."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from featuresel.candidates import Chain
from featuresel.case import LookCase
from featuresel.routines import Failure, load
from featuresel.trials import Outcome, Prepared, is_wrong

CONFIDENCE = 0.95  # of all bounds, one-sided


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What the trials said of one chain; statistics are over its successes."""

    chain: Chain
    trials: int
    success: int  # answered, and not wrong
    success_lower: float  # Clopper-Pearson, one-sided 95 %
    silent: int  # answered, but wrong
    silent_upper: float  # Clopper-Pearson, one-sided 95 %
    failures: tuple[tuple[str, int], ...]  # code and count, by code
    bias_um: tuple[float, float] | None  # mean error in the target's frame
    sigma_um: float | None  # about the bias, the larger axis
    worst_um: float | None  # length of the largest error, wrong answers included
    angles: int  # successes that gave an angle
    bias_theta_rad: float | None
    sigma_theta_rad: float | None
    cost: float  # of one fix, in 640 x 480 box filters

    @property
    def need_um(self) -> float:
        """Return 2 sigma + |bias|, what a tolerance must hold; inf without success."""
        if self.bias_um is None or self.sigma_um is None:
            return math.inf
        return 2 * self.sigma_um + math.hypot(*self.bias_um)

    @property
    def need_theta_rad(self) -> float:
        """Return 2 sigma + |bias| of the angle; inf where it is not always given."""
        if self.bias_theta_rad is None or self.sigma_theta_rad is None:
            return math.inf
        if self.angles < self.success:
            return math.inf
        return 2 * self.sigma_theta_rad + abs(self.bias_theta_rad)


def score(
    case: LookCase, prepared: Prepared, outcomes: Sequence[Outcome]
) -> tuple[Score, ...]:
    """Return one score per chain, in the order of `prepared.chains`.

    A success is an answer within `WRONG_TOLERANCES` tolerances (place, and angle where
    it is needed and given); a silent failure is any other answer.
    """
    return tuple(
        _score(
            case,
            chain,
            [o for o in outcomes if o.chain == chain],
            chain_cost(case, prepared, chain),
        )
        for chain in prepared.chains
    )


def chain_cost(case: LookCase, prepared: Prepared, chain: Chain) -> float:
    """Return the predicted work of one fix, in 640 x 480 box filters.

    A routine that could not be prepared costs nothing: it never runs.
    """
    pixels, total = case.window.rows * case.window.columns, 0.0
    for name in chain:
        artifact = prepared.artifacts[name]
        if not isinstance(artifact, Failure):
            total += load(name).cost(artifact, pixels)
    return total


def success_lower(success: int, trials: int) -> float:
    """Return the least success rate that is not refuted at 95 %, one-sided.

    References
    ----------
    Clopper & Pearson (1934).
    """
    _check(success, trials)
    if success == 0:
        return 0.0
    return float(beta.ppf(1 - CONFIDENCE, success, trials - success + 1))


def failure_upper(failures: int, trials: int) -> float:
    """Return the largest failure rate that is not refuted at 95 %, one-sided."""
    _check(failures, trials)
    if failures == trials:
        return 1.0
    return float(beta.ppf(CONFIDENCE, failures + 1, trials - failures))


def _check(count: int, trials: int) -> None:
    if not 0 <= count <= trials or trials < 1:
        raise ValueError(f"need 0 <= count <= trials and trials >= 1, got {count}")


def _score(
    case: LookCase, chain: Chain, outcomes: Sequence[Outcome], cost: float
) -> Score:
    """Return the score of one chain."""
    answered = [o for o in outcomes if o.failure is None]
    right = [o for o in answered if not is_wrong(case, o)]
    silent = len(answered) - len(right)
    codes = Counter(o.failure for o in outcomes if o.failure is not None)
    errors = np.array([o.target_um for o in right if o.target_um is not None])
    turns = np.array([o.theta_rad for o in right if o.theta_rad is not None])
    many = len(errors) >= 2  # a spread needs two
    return Score(
        chain=chain,
        trials=len(outcomes),
        success=len(right),
        success_lower=success_lower(len(right), len(outcomes)),
        silent=silent,
        silent_upper=failure_upper(silent, len(outcomes)),
        failures=tuple(sorted(codes.items())),
        bias_um=(float(errors[:, 0].mean()), float(errors[:, 1].mean()))
        if many
        else None,
        sigma_um=float(errors.std(axis=0, ddof=1).max()) if many else None,
        worst_um=max((o.distance_um for o in answered), default=None),
        angles=len(turns),
        bias_theta_rad=float(turns.mean()) if len(turns) >= 2 else None,
        sigma_theta_rad=float(turns.std(ddof=1)) if len(turns) >= 2 else None,
        cost=cost,
    )
