"""Comparisons without chains that are rejected for reasons that no trial shows."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import (
    RejectedChains,
    RoutineComparison,
    compare_routines,
)
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.trials import run
from microplan.optics.render.scene import Window
from tests.featuresel.conftest import post_alone
from tests.featuresel.selection.test_select import a_score

SEED, MOST = 5, 27
WHY = "its images are wrong"


@pytest.fixture(scope="module")
def post() -> LookCase:
    """Return the post in a small region."""
    case = post_alone()
    window = Window(row=case.window.row + 50, column=case.window.column + 50,
                    rows=100, columns=100)  # fmt: skip
    target = replace(
        case.target, column=case.target.column - 50, row=case.target.row - 50
    )
    return replace(case, window=window, target=target, tolerance_um=0.8)


@pytest.fixture(scope="module")
def first(post: LookCase) -> RoutineComparison:
    return compare_routines(post, root_seed=SEED, most=MOST, limited=False)


def used(found: RoutineComparison) -> tuple[Chain, ...]:
    both = (found.selection.chosen, found.selection.fallback)
    return tuple(score.chain for score in both if score is not None)


def test_the_next_ones_have_the_trials_that_a_choice_rests_on(
    post: LookCase, first: RoutineComparison
) -> None:
    """By all trials of all other chains, whoever waited in the race."""
    out = RejectedChains(before=first, reasons=dict.fromkeys(used(first), WHY))
    found = compare_routines(
        post, root_seed=SEED, most=MOST, limited=False, rejected=out
    )
    waited = [s.chain for s in first.scores if s.trials < MOST]
    assert set(used(found)) <= set(waited)
    others = replace(
        first.prepared,
        chains=tuple(c for c in first.prepared.chains if c not in used(first)),
    )
    whole = score(post, others, run(post, others, design(post, MOST, SEED)))
    task = Constraints(tolerance_um=post.tolerance_um, tolerance_theta_rad=None)
    judged = select(whole, task)
    assert judged.chosen is not None
    assert judged.fallback is not None
    assert used(found) == (judged.chosen.chain, judged.fallback.chain)
    for chain in used(found):
        (mine,) = (s for s in found.scores if s.chain == chain)
        (theirs,) = (s for s in whole if s.chain == chain)
        assert (mine.trials, mine.need_um) == (MOST, theirs.need_um)
    reasons = dict(found.selection.reasons)
    for chain in used(first):
        assert reasons[chain] == f"rejected: {WHY}"
        kept = [s for s in (*first.scores, *found.scores) if s.chain == chain]
        assert kept[0] == kept[1]
        assert list(found.outcomes.by(chain)) == list(first.outcomes.by(chain))
    assert {s.chain for s in found.scores} == {s.chain for s in first.scores}


def test_where_all_are_rejected_none_is_chosen(
    post: LookCase, first: RoutineComparison
) -> None:
    passing = [s.chain for s in first.scores]
    out = RejectedChains(before=first, reasons=dict.fromkeys(passing, WHY))
    found = compare_routines(
        post, root_seed=SEED, most=MOST, limited=False, rejected=out
    )
    rest = {s.chain for s in found.scores} - set(passing)  # the expensive ones
    assert not set(used(found)) - rest


def test_a_rejected_chain_is_neither_chosen_nor_on_the_front() -> None:
    scores = [a_score("a", 0.1, 1.0), a_score("b", 0.05, 2.0), a_score("c", 0.1, 3.0)]
    task = Constraints(
        tolerance_um=1.0, tolerance_theta_rad=None, rejected={("a",): WHY}
    )
    found = select(scores, task)
    assert (found.chosen, found.fallback) == (scores[1], scores[2])
    assert scores[0] not in found.pareto
    assert dict(found.reasons)[("a",)] == f"rejected: {WHY}"
