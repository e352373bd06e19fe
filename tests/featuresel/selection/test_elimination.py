"""What a race may conclude from scores."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import HALF_DESIGN
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Principle
from microplan.featuresel.selection.constraints import Limits
from microplan.featuresel.selection.elimination import Elimination
from microplan.featuresel.trials.bounds import estimate, failure_upper, success_lower
from microplan.featuresel.trials.score import ChainScore

Look = Callable[[str], LookCase]
TRIALS = 400
ERRORS = np.random.default_rng(1).normal(0.0, 0.05, (TRIALS, 2))


@pytest.fixture
def verdicts(look: Look) -> Elimination:
    case = look("post")  # within 1 um
    return Elimination(case=case, limits=Limits(), interim_tests=3, in_set=False)


def both_ways(chain: str = "whole") -> ChainScore:
    return ChainScore(
        chain=("seed", chain), trials=TRIALS, success=TRIALS,
        success_lower=success_lower(TRIALS, TRIALS), silent=0,
        silent_upper=failure_upper(0, TRIALS), failures=(), bias_um=(0.0, 0.0),
        sigma_um=0.05, worst_um=0.2, angles=TRIALS, bias_theta_rad=0.0,
        sigma_theta_rad=0.001, cost=1.0, x=estimate(ERRORS[:, 0]),
        y=estimate(ERRORS[:, 1]),
    )  # fmt: skip


def one_way(chain: str = "edge") -> ChainScore:
    along = estimate(ERRORS[:, 0] / 10)
    return replace(both_ways(chain), x=None, y=None, along=along, axis_rad=0.3)


def test_a_place_in_one_direction_decides_nothing_where_both_are_needed(
    verdicts: Elimination,
) -> None:
    cheap = replace(one_way(), cost=0.5)
    assert verdicts.is_decided([both_ways()])
    assert not verdicts.is_decided([cheap])
    assert not verdicts.is_decided([cheap, both_ways()])
    assert not verdicts.meets(cheap)
    assert verdicts.use(cheap) == math.inf
    # finer along its one direction, and yet it makes nothing superfluous
    coarse = replace(both_ways(), x=estimate(ERRORS[:, 0] * 5))
    assert verdicts.dominated(coarse, [cheap]) == ""


def test_a_place_in_one_direction_is_out_where_both_are_needed(
    verdicts: Elimination,
) -> None:
    ((chain, reason),) = verdicts.fallen([one_way(), both_ways()])
    assert chain == ("seed", "edge")
    assert reason == "tells the place in one direction only, both are needed"


def test_in_a_set_one_direction_will_do(verdicts: Elimination) -> None:
    member = replace(verdicts, in_set=True)
    assert member.meets(one_way())
    assert member.is_decided([one_way()])
    assert member.fallen([one_way()]) == []
    # but needs along an edge and of a place do not compare
    coarse = replace(both_ways(), x=estimate(ERRORS[:, 0] * 5))
    assert member.dominated(coarse, [one_way()]) == ""
    assert member.dominated(coarse, [both_ways("fine")]) != ""


def shown(trials: int, wrong: int, principle: Principle, cost: float) -> ChainScore:
    """Return what a chain with margin has shown in so many trials."""
    right = trials - wrong
    return replace(
        both_ways(principle), principle=principle, trials=trials, success=right,
        success_lower=success_lower(right, trials), cost=cost,
        silent_upper=failure_upper(0, trials), angles=right,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("trials", "wrong", "spare", "most", "ends"),
    [
        (HALF_DESIGN, (0, 0), "area", 64, True),
        (HALF_DESIGN, (1, 0), "area", 64, False),
        (HALF_DESIGN, (0, 1), "area", 64, False),
        (HALF_DESIGN, (0, 0), "edges", 64, False),  # nothing else to fall back on
        (HALF_DESIGN - 1, (0, 0), "area", 64, False),
        (HALF_DESIGN, (0, 0), "area", 1024, False),  # so many would prove it
        (HALF_DESIGN, (0, 0), "area", None, False),
    ],
)
def test_a_race_may_end_without_proof_where_two_principles_were_always_right(
    verdicts: Elimination,
    trials: int,
    wrong: tuple[int, int],
    spare: Principle,
    most: int | None,
    ends: bool,
) -> None:
    asked = replace(verdicts, most=most)
    own, other = wrong
    left = [shown(trials, own, "edges", 1.0), shown(trials, other, spare, 2.0)]
    assert asked.is_decided(left) is ends


@pytest.mark.parametrize(
    ("wrong", "ends"),
    [(1, False), (2, True)],  # with .98 of 64 asked: it may pass yet, it cannot
)
def test_a_race_does_not_wait_for_a_chain_that_failed_too_often(
    verdicts: Elimination, wrong: int, ends: bool
) -> None:
    asked = replace(verdicts, most=64)
    left = [
        shown(HALF_DESIGN, wrong, "area", 0.5),
        shown(HALF_DESIGN, 0, "edges", 1.0),
        shown(HALF_DESIGN, 0, "area", 2.0),
    ]
    assert asked.is_decided(left) is ends
    assert not asked.is_decided(left[:2])  # the failed one is no spare
