"""How often a chain and its fallback fail together, by answers that are made up."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import pytest

from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import ChainScore, score_chain
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.records import fallback_record
from tests.planner.looks.test_scale_free_sigma import with_outcomes

AREA, EDGES = ("otsu",), ("contour_match",)
TRIALS = 20


def answers(
    chain: tuple[str, ...], *, silent: Collection[int] = (), wrong: Collection[int] = ()
) -> list[Outcome]:
    """Return one answer a trial; some are missing, some are far off."""
    return [
        Outcome(chain=chain, trial=k, failure="no_edge")
        if k in silent
        else Outcome(
            chain=chain, trial=k, world_um=(99.0 * (k in wrong), 0.0),
            target_um=(0.0, 0.0), theta_rad=0.0, spread_um=0.01,
        )
        for k in range(TRIALS)
    ]  # fmt: skip


def scored(tried: Evaluation, outcomes: list[Outcome]) -> ChainScore:
    found = score_chain(tried.case, outcomes[0].chain, outcomes, 1.0)
    edges = outcomes[0].chain == EDGES
    return replace(found, principle="edges" if edges else "area")


def test_failures_together_are_counted_on_the_same_trials(tried: Evaluation) -> None:
    own = answers(AREA, silent=(0, 1, 2), wrong=(3,))
    spare = answers(EDGES, silent=(2, 3, 9))[:10]  # it waited after ten
    look = with_outcomes(tried, Outcomes.of([*own, *spare]))
    found = fallback_record(look, scored(tried, own), scored(tried, spare))
    assert (found.principle, found.other_principle) == ("area", "edges")
    assert (found.trials, found.chain_failed, found.both_failed) == (10, 4, 2)
    assert not found.lack
    # Clopper-Pearson: two failures or fewer of ten have a probability of 5 % there
    p = found.both_failed_upper
    tail = sum(math.comb(10, k) * p**k * (1 - p) ** (10 - k) for k in range(3))
    assert tail == pytest.approx(0.05, abs=1e-9)


def test_a_fallback_of_the_same_principle_says_what_is_lacking(
    tried: Evaluation,
) -> None:
    own, spare = answers(AREA, silent=(4,)), answers(("ncc",), silent=(4, 5))
    look = with_outcomes(tried, Outcomes.of([*own, *spare]))
    found = fallback_record(look, scored(tried, own), scored(tried, spare))
    assert found.other_principle == "area"
    assert "no chain by edges passes" in found.lack
    assert "1 of 20 trials need another look" in found.lack


def test_no_fallback_says_what_that_costs(tried: Evaluation) -> None:
    own = answers(AREA, silent=(4, 7))
    look = with_outcomes(tried, Outcomes.of(own))
    found = fallback_record(look, scored(tried, own), None)
    assert (found.other_principle, found.both_failed, found.trials) == ("", 2, TRIALS)
    assert "no other chain passes: 2 of 20 trials" in found.lack
