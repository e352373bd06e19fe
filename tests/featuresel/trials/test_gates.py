"""Gates on the score: what they refuse, what they cost, and that their bound holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta, binom

from benchmarks.selection.promises import GATED, gated
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bounds import failure_upper
from microplan.featuresel.trials.gates import Gate, choose_gate
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.trials import prepare

Look = Callable[[str], LookCase]
CHAIN = ("circle_caliper",)


def answers(
    scores: list[float], *, right: bool, spread_um: float = 0.01
) -> list[Outcome]:
    """Return answers that are .1 um off if right, 5 um if wrong."""
    error = (0.1, 0.0) if right else (5.0, 0.0)
    return [
        Outcome(
            chain=CHAIN,
            trial=k,
            failure=None,
            world_um=error,
            target_um=error,
            theta_rad=None,
            score=value,
            spread_um=spread_um,
        )
        for k, value in enumerate(scores)
    ]


def sure(found: Gate | None) -> Gate:
    assert found is not None
    return found


def test_without_a_wrong_answer_the_gate_lies_beyond_all_right_ones(look: Look) -> None:
    outcomes = answers(list(np.linspace(0.7, 0.9, 101)), right=True)
    gate = sure(choose_gate(look("post"), outcomes, silent_limit=0.05))
    assert gate.min_score == pytest.approx(0.6)  # .1 below .7, as that is below .8
    assert (gate.silent, gate.lost, gate.kept) == (0, 0, 101)
    assert gate.loss == pytest.approx(1 / 102)
    assert gate.silent_upper == failure_upper(0, 101, 0.975) < 0.05
    assert gate.passes(0.6001, 0.01)
    assert not gate.passes(0.5999, 0.01)


def test_a_wrong_answer_shuts_the_gate_above_it(look: Look) -> None:
    right = answers([0.6 + 0.003 * k for k in range(100)], right=True)
    outcomes = right + answers([0.2, 0.6045], right=False)
    gate = sure(choose_gate(look("post"), outcomes, silent_limit=0.01))
    assert 0.6045 < gate.min_score < 0.606
    assert (gate.silent, gate.lost, gate.kept) == (0, 2, 98)
    assert gate.loss == pytest.approx(3 / 101)
    # of 102 trials one may be wrong where 6 % are allowed
    lax = sure(choose_gate(look("post"), outcomes, silent_limit=0.06))
    assert lax.lost == 0
    assert lax.silent <= 1
    assert lax.silent_upper == failure_upper(1, 102, 0.975) <= 0.06


def test_a_gate_refuses_wrong_answers_alone(look: Look) -> None:
    """What right answers score on other images may lie lower than all in trials."""
    right = answers(list(np.linspace(0.7, 0.9, 101)), right=True)
    none = sure(choose_gate(look("post"), right, silent_limit=0.05))
    assert (none.refuses, none.cap_um) == (0.0, math.inf)
    low = answers([0.3], right=False)
    some = sure(choose_gate(look("post"), right + low, silent_limit=0.01))
    assert 0.3 < some.refuses <= some.min_score < 0.7


def test_a_spread_beyond_the_tolerance_tells_wrong_answers_apart(look: Look) -> None:
    right = answers([0.5 + 0.004 * k for k in range(100)], right=True)
    outcomes = right + answers([0.95], right=False, spread_um=1.5)
    gate = sure(choose_gate(look("post"), outcomes, silent_limit=0.01))
    assert gate.max_spread_um <= 1.0
    assert (gate.silent, gate.lost) == (0, 0)


def test_where_wrong_answers_score_best_there_is_no_gate(look: Look) -> None:
    outcomes = answers([0.5, 0.6], right=True) + answers([0.9], right=False)
    assert choose_gate(look("post"), outcomes, silent_limit=0.01) is None


def test_failures_aloud_do_not_matter(look: Look) -> None:
    case, right = look("post"), answers([0.5, 0.6, 0.7], right=True)
    quiet = [gated(o, _gate(2.0)) for o in right]
    assert {o.failure for o in quiet} == {GATED}
    gate = sure(choose_gate(case, right + quiet, silent_limit=0.01))
    assert (gate.kept, gate.lost) == (3, 0)


def _gate(min_score: float) -> Gate:
    return Gate(
        min_score=min_score, refuses=0.0, cap_um=math.inf, max_spread_um=math.inf,
        silent=0, silent_upper=0.0, kept=0, lost=0, loss=0.0,
    )  # fmt: skip


def test_what_a_gate_refuses_is_scored_as_a_failure(look: Look) -> None:
    case = look("post")
    outcomes = answers([0.8, 0.9], right=True) + answers([0.3], right=False)
    ready = prepare(case, [CHAIN])
    (before,) = score(case, ready, outcomes)
    (after,) = score(case, ready, [gated(o, _gate(0.5)) for o in outcomes])
    assert (before.success, before.silent) == (2, 1)
    assert (after.success, after.silent) == (2, 0)
    assert after.failures == ((GATED, 1),)


def test_the_bound_holds_although_the_gate_is_chosen_on_the_same_trials(
    look: Look,
) -> None:
    """Wrong answers, a fifth of all, score as high as right ones now and then."""
    case, rng = replace(look("post"), tolerance_um=1.0), np.random.default_rng(8)
    repeats, limit, broken, lost = 300, 0.05, 0, []
    for _ in range(repeats):
        wrong = int(rng.binomial(200, 0.2))
        outcomes = answers(list(rng.beta(2, 4, wrong)), right=False)
        outcomes += answers(list(rng.beta(6, 2, 200 - wrong)), right=True)
        gate = sure(choose_gate(case, outcomes, silent_limit=limit))
        broken += 0.2 * beta.sf(gate.min_score, 2, 4) > gate.silent_upper
        lost.append(beta.cdf(gate.min_score, 6, 2) - gate.loss)
    # 5 % may be, and by chance up to the 99.9 % quantile
    assert broken <= binom.ppf(0.999, repeats, 0.05)
    # the expected loss is that of later answers: within 4 standard errors, or less
    assert np.mean(lost) < 4 * np.std(lost) / math.sqrt(repeats)


@pytest.mark.parametrize("limit", [0.0, 1.0, math.nan])
def test_nonsense_is_an_error(limit: float, look: Look) -> None:
    case = look("post")
    with pytest.raises(ValueError, match="silent_limit"):
        choose_gate(case, answers([0.5], right=True), silent_limit=limit)
    with pytest.raises(ValueError, match="outcomes"):
        choose_gate(case, [], silent_limit=0.01)
