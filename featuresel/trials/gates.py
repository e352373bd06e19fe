"""The least score at which a chain's answer is accepted, so that few wrong ones are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bounds import CONFIDENCE, failure_upper
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import is_wrong


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """What an answer must meet to be believed, and what that costs."""

    min_score: float
    refuses: float  # no score below this may pass: wrong answers have it
    cap_um: float  # no larger standard deviation may pass; inf: any
    max_spread_um: float  # of the chain's own standard deviation; inf: any
    silent: int  # wrong answers that still pass
    silent_upper: float  # of their rate per look, one-sided
    kept: int  # right answers that pass
    lost: int  # right ones that do not
    loss: float  # expected share of later right answers that will not

    def passes(self, score: float, spread_um: float) -> bool:
        """Return whether an answer is accepted."""
        return score >= self.min_score and spread_um <= self.max_spread_um


def choose_gate(
    case: LookCase,
    outcomes: Sequence[Outcome],
    *,
    silent_limit: float,
) -> Gate | None:
    """Return the gate that keeps the silent failures of a chain below a limit.

    Parameters
    ----------
    case : LookCase
        The look: what is wrong depends on its tolerances.
    outcomes : sequence of Outcome
        Of one chain, one for each trial, at least one.
    silent_limit : float
        The largest rate of silent failures per look. Where trials are too few to show
        it even without a wrong answer, none may pass.

    Returns
    -------
    Gate or None
        Of all that keep the limit the one that loses fewest right answers, then the one
        that leaves the most room to the scores seen; None if no right answer is left.

    Raises
    ------
    ValueError
        If there is no outcome, they are of several chains, or the limit is not in 0..1.

    Notes
    -----
    The bound holds although the gate is chosen on the trials it is judged by. The rate
    r(t) of wrong answers that score at least t falls with t; let t* be the threshold
    where it is the limit. The gate lets pass the most wrong answers, m, whose
    Clopper-Pearson bound is below the limit. It lies below t* only if at most m wrong
    answers scored t* or more, and that has a probability of 1 - `CONFIDENCE` at most.
    This is a test of a fixed sequence of hypotheses, strictest first (Angelopoulos,
    Bates, Candes, Jordan & Lei 2021, Learn then Test), on a continuum of them. A limit
    of the spread is laid over it twice: at the tolerance, fixed beforehand, each of the
    two families with half of the doubt; and beyond the right answers seen, which can
    only refuse more.

    The expected share of right answers lost is (lost + 1) / (right + 1), that of the
    next of exchangeable scores below one of those seen.
    """
    if not outcomes or len({o.chain for o in outcomes}) != 1:
        raise ValueError("outcomes must be of one chain, and at least one")
    if not 0 < silent_limit < 1:
        raise ValueError(f"silent_limit must be in 0..1, got {silent_limit}")
    right, wrong = _answers(case, outcomes)
    level = 1 - (1 - CONFIDENCE) / 2
    limit = max(silent_limit, failure_upper(0, len(outcomes), level))
    found = [
        _gate(right, wrong, cap, len(outcomes), limit, level)
        for cap in (math.inf, case.tolerance_um)
    ]
    best = min(found, key=lambda gate: gate.lost)  # the first where both lose alike
    return best if best.kept else None


def _answers(
    case: LookCase, outcomes: Sequence[Outcome]
) -> tuple[FloatArray, FloatArray]:
    """Return (score, spread um) of the right answers and of the wrong ones."""
    right: list[tuple[float, float]] = []
    wrong: list[tuple[float, float]] = []
    for outcome in outcomes:
        if outcome.score is not None and outcome.spread_um is not None:
            kind = wrong if is_wrong(case, outcome) else right
            kind.append((outcome.score, outcome.spread_um))
    return (
        np.array(right, dtype=np.float64).reshape(-1, 2),
        np.array(wrong, dtype=np.float64).reshape(-1, 2),
    )


def _gate(
    right: FloatArray,
    wrong: FloatArray,
    cap_um: float,
    trials: int,
    limit: float,
    level: float,
) -> Gate:
    """Return the laxest gate below the limit, then as strict as costs nothing."""
    good, bad = right[right[:, 1] <= cap_um], wrong[wrong[:, 1] <= cap_um]
    allowed = _allowed(len(bad), trials, limit, level)
    least = 0.0
    if allowed < len(bad):
        refused = np.sort(bad[:, 0])[::-1][allowed]
        least = _above(refused, np.concatenate((good[:, 0], bad[:, 0])))
    good, refuses, widest = good[good[:, 0] >= least], least, cap_um
    if len(good):
        least = max(least, _below(good[:, 0]))
        cap_um = min(cap_um, -_below(-good[:, 1]))
    silent = int(((bad[:, 0] >= least) & (bad[:, 1] <= cap_um)).sum())
    lost = len(right) - len(good)
    return Gate(
        min_score=float(least),
        refuses=float(refuses),
        cap_um=float(widest),
        max_spread_um=float(cap_um),
        silent=silent,
        silent_upper=failure_upper(min(allowed, len(bad)), trials, level),
        kept=len(good),
        lost=lost,
        loss=(lost + 1) / (len(right) + 1),
    )


def _allowed(wrong: int, trials: int, limit: float, level: float) -> int:
    """Return how many wrong answers may pass and the bound still be below the limit."""
    count = 0
    while count < wrong and failure_upper(count + 1, trials, level) <= limit:
        count += 1
    return count


def _above(refused: float, scores: FloatArray) -> float:
    """Return the middle between a score that must not pass and the next that may."""
    higher = scores[scores > refused]
    return float((refused + higher.min()) / 2) if len(higher) else math.inf


def _below(values: FloatArray) -> float:
    """Return a bound as far below the least value as that is below the median."""
    return float(2 * values.min() - np.median(values))
