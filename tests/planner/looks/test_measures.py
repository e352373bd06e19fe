"""Acceptance gates of a measurement, by answers that are made up."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import pytest

from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import score_chain
from microplan.featuresel.trials.trials import WRONG_TOLERANCES
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.measures import (
    LACKS,
    SCORE_MARGIN,
    SHIFT_MARGIN,
    SHORTFALL,
    SPREAD_MARGIN,
    acceptance_gates,
    usual_score,
)
from microplan.planner.looks.model_errors.model_cost import AcceptedRange
from microplan.schemas.plan import Gates
from tests.planner.looks.conftest import CHAIN

ENOUGH = 400  # trials that show a limit of undetected failures


def answers(scores: Iterable[float], error_um: float) -> list[Outcome]:
    return [
        Outcome(
            chain=CHAIN, trial=k, world_um=(error_um, 0.0), target_um=(error_um, 0.0),
            score=score, spread_um=0.01,
        )
        for k, score in enumerate(scores)
    ]  # fmt: skip


def gates(tried: Evaluation, outcomes: list[Outcome], accepted: AcceptedRange) -> Gates:
    """Return the gates by these answers, numbered anew."""
    numbered = [replace(o, trial=k) for k, o in enumerate(outcomes)]
    rows = Outcomes.of(numbered)
    seen = replace(tried, comparison=replace(tried.comparison, outcomes=rows))
    chosen = score_chain(tried.case, CHAIN, rows, 1.0)
    return acceptance_gates(seen, chosen, accepted)


def good(least: float) -> list[Outcome]:
    return answers([least + 0.1 * (k % 4) for k in range(ENOUGH)], 0.0)


def test_gates_lie_a_margin_outside_what_right_answers_show(tried: Evaluation) -> None:
    found = gates(tried, good(0.6), AcceptedRange())
    assert found.min_score == pytest.approx(SCORE_MARGIN * 0.6)
    assert found.max_shift_um == SHIFT_MARGIN * tried.case.spread.search_um
    # right answers are surer than the tolerance: that is allowed in any case
    assert found.max_spread_um == tried.case.tolerance_um


def test_near_perfect_scores_leave_room_for_what_trials_showed_six_times() -> None:
    """The rule of shares below, of shortfalls above, without a step between them."""
    assert usual_score(0.98) == pytest.approx(1 - SHORTFALL * 0.02)
    assert usual_score(0.9) == SCORE_MARGIN * 0.9
    assert usual_score(0.0) == 0.0
    assert usual_score(1.0) == 1 - SHORTFALL * LACKS
    rising = [usual_score(k / 1000) for k in range(1001)]
    assert rising == sorted(rising)
    assert max(b - a for a, b in pairwise(rising)) < 0.01


def test_right_answers_on_better_images_are_among_them(tried: Evaluation) -> None:
    wide_um = 0.8 * tried.case.tolerance_um
    low = AcceptedRange(least_score=0.5, widest_um=wide_um)
    found = gates(tried, good(0.6), low)
    assert found.min_score == pytest.approx(SCORE_MARGIN * 0.5)
    assert found.max_spread_um == pytest.approx(SPREAD_MARGIN * wide_um)
    same = gates(tried, good(0.6), AcceptedRange(least_score=0.9))
    assert same == gates(tried, good(0.6), AcceptedRange())


def test_wrong_answers_are_refused_though_right_ones_score_as_little(
    tried: Evaluation,
) -> None:
    far_um = 1.01 * WRONG_TOLERANCES * tried.case.tolerance_um
    wrong = answers([0.55] * 40, far_um)
    found = gates(tried, [*good(0.6), *wrong], AcceptedRange())
    assert 0.55 < found.min_score <= 0.6
    right = answers([0.55] * 40, 0.99 * far_um / 1.01)
    kept = gates(tried, [*good(0.6), *right], AcceptedRange())
    assert kept.min_score == pytest.approx(SCORE_MARGIN * 0.55)


def test_without_a_right_answer_no_score_is_asked_for(tried: Evaluation) -> None:
    lost = [Outcome(chain=CHAIN, trial=k, failure="no_edge") for k in range(9)]
    found = gates(tried, lost, AcceptedRange(least_score=0.5))
    assert found.min_score == 0.0
    assert math.isfinite(found.max_spread_um or math.inf)
