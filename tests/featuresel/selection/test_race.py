"""Races: the same trials for all, fewer for those that cannot be chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from microplan.featuresel.look.design import HALF_DESIGN, design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.race import ROUNDS, Race, race
from microplan.featuresel.selection.select import Limits, select
from microplan.featuresel.trials.bounds import (
    CONFIDENCE,
    estimate,
    failure_upper,
    success_lower,
)
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.trials import PreparedRoutines, prepare, run
from microplan.optics.render.scene import Window

Look = Callable[[str], LookCase]
FINE, COARSE, BEHIND = ("circle_caliper",), ("otsu",), ("otsu", "circle_caliper")
BLIND = ("otsu", "tooth_notch")  # there are no teeth on a post


CUT_PX = 64  # on each side, of a region of 200 x 200 pixels


@pytest.fixture
def post(look: Look) -> LookCase:
    """Return the post in a small region, to be found within .09 um."""
    case = look("post")
    window = Window(row=case.window.row + CUT_PX, column=case.window.column + CUT_PX,
                    rows=200 - 2 * CUT_PX, columns=200 - 2 * CUT_PX)  # fmt: skip
    target = replace(
        case.target, column=case.target.column - CUT_PX, row=case.target.row - CUT_PX
    )
    return replace(case, window=window, target=target, tolerance_um=0.09)


@pytest.fixture
def ready(post: LookCase) -> PreparedRoutines:
    return prepare(post, [FINE, COARSE, BEHIND, BLIND])


def held(case: LookCase, ready: PreparedRoutines, **more: float) -> Race:
    limits = Limits(**more)
    return race(case, ready, root_seed=5, most=64, rounds=(16, 32), limits=limits)


def test_hopeless_chains_are_dropped_and_the_choice_stays(
    post: LookCase, ready: PreparedRoutines
) -> None:
    found = held(post, ready)
    assert found.trials == {FINE: 64, COARSE: 32, BEHIND: 64, BLIND: 16}
    reasons = dict(found.dropped)
    assert "2 sigma + |bias| above" in reasons[COARSE]
    assert reasons[BLIND].startswith("success below")
    assert found.interim_tests == 3
    whole = run(post, ready, design(post, 64, 5))
    full = select(
        score(post, ready, whole),
        Constraints(tolerance_um=0.09, tolerance_theta_rad=None),
    )
    raced = select(
        found.scores, Constraints(tolerance_um=0.09, tolerance_theta_rad=None)
    )
    assert raced.chosen is not None
    assert full.chosen is not None
    assert raced.chosen.chain == full.chosen.chain
    assert raced.chosen.need_um == full.chosen.need_um


def test_a_race_shows_the_chains_what_trials_without_one_would(
    post: LookCase, ready: PreparedRoutines
) -> None:
    found = race(post, ready, root_seed=5, most=20, rounds=(16,))
    whole = {(o.chain, o.trial): o for o in run(post, ready, design(post, 20, 5))}
    assert all(whole[o.chain, o.trial] == o for o in found.outcomes)
    for chain, count in found.trials.items():
        mine = [o.trial for o in found.outcomes if o.chain == chain]
        assert mine == list(range(count))
    assert race(post, ready, root_seed=5, most=20, rounds=(16,)) == found
    fine = next(s for s in found.scores if s.chain == FINE)
    # the bounds are widened by the rounds
    assert fine.success_lower == pytest.approx((0.05 / 2) ** (1 / 20))


def test_a_race_without_hope_ends_at_once(
    post: LookCase, ready: PreparedRoutines
) -> None:
    found = held(replace(post, tolerance_um=1e-4), ready)
    assert set(found.trials.values()) == {16}
    assert len(found.dropped) == 4


def test_a_race_ends_when_one_chain_is_proved_and_no_cheaper_one_is_left(
    post: LookCase,
) -> None:
    lone, margin_share = prepare(post, [FINE]), replace(post, tolerance_um=1.0)
    # 32 successes of 32 show .843 at 1 - .05 / 12, no failure a rate below .157
    found = held(margin_share, lone, success=0.84, silent_upper=0.16)
    assert found.trials == {FINE: 32}
    assert held(margin_share, lone, success=0.85, silent_upper=0.16).trials == {
        FINE: 64
    }
    assert held(margin_share, lone, success=0.84, silent_upper=0.15).trials == {
        FINE: 64
    }


def test_a_race_without_proof_ends_when_two_principles_were_always_right(
    post: LookCase,
) -> None:
    both, wide = prepare(post, [FINE, COARSE]), replace(post, tolerance_um=2.0)

    def trials(
        ready: PreparedRoutines, *, success: float = 0.98, waits: bool = True
    ) -> set[int]:
        found = race(
            wide, ready, root_seed=5, most=64, rounds=(16, HALF_DESIGN),
            limits=Limits(success=success),
            ahead=(lambda scores: [s.chain for s in scores]) if waits else None,
        )  # fmt: skip
        assert all(s.success == s.trials for s in found.scores)
        return set(found.trials.values())

    assert trials(both) == {HALF_DESIGN}
    assert trials(both, waits=False) == {64}
    assert trials(both, success=0.93) == {64}  # 64 of 64 would show .938
    assert trials(prepare(post, [FINE])) == {64}  # nothing to fall back on
    assert trials(prepare(post, [COARSE, (*COARSE, "otsu")])) == {64}


def test_a_dearer_and_coarser_chain_of_the_same_beginning_is_dropped(
    post: LookCase,
) -> None:
    worse = (*BEHIND, "hough")
    ready = prepare(post, [BEHIND, worse, FINE])
    margin_share = replace(post, tolerance_um=2.0)
    found = race(margin_share, ready, root_seed=5, most=136, rounds=(128,))
    assert found.trials == {BEHIND: 136, FINE: 136, worse: 128}
    ((chain, reason),) = found.dropped
    assert chain == worse
    assert reason == "otsu > circle_caliper is no dearer and more accurate"


def test_a_chain_at_the_limit_is_seldom_dropped() -> None:
    """Of three rounds' bounds together at most 5 % may refute the true rate."""
    rng = np.random.default_rng(3)
    repeats, rate, level = 400, 0.98, 1 - (1 - CONFIDENCE) / (4 * len(ROUNDS))
    dropped = 0
    for _ in range(repeats):
        wins = np.cumsum(rng.random(ROUNDS[-1]) < rate)
        dropped += any(
            failure_upper(int(wins[end - 1]), end, level) < rate for end in ROUNDS
        )
    assert dropped <= binom.ppf(0.999, repeats, 0.05)


def test_bounds_of_whoever_wins_two_races_hold() -> None:
    """The second race is run where the first one's outcomes look bad, and its chain
    wins where its own look better: bounds of the winner, at whatever round it stops.
    """
    rng = np.random.default_rng(8)
    repeats, rate, ends = 300, 0.98, (8, 24, 64)
    level = 1 - (1 - CONFIDENCE) / (2 * len(ends))
    broken = {"success": 0, "sigma": 0, "need": 0}
    for _ in range(repeats):
        stops = []
        for _ in range(2):
            wins = np.cumsum(rng.random(ends[-1]) < rate)
            errors = rng.normal(0.0, 1.0, ends[-1])
            for end in ends:
                known = estimate(errors[:end], level)
                assert known is not None
                stops.append(
                    (success_lower(int(wins[end - 1]), end, level), known.sigma_upper,
                     known.need_upper)
                )  # fmt: skip
        broken["success"] += max(s[0] for s in stops) > rate
        broken["sigma"] += min(s[1] for s in stops) < 1.0
        # 2 sigma + |bias| is 2: sigma's and the mean's bounds have a doubt each
        broken["need"] += min(s[2] for s in stops) < 2.0
    chance = binom.ppf(0.999, repeats, 1 - CONFIDENCE)
    assert all(count <= chance for count in broken.values()), broken


def test_the_rounds_of_another_race_widen_the_bounds(
    post: LookCase, ready: PreparedRoutines
) -> None:
    found = race(post, ready, root_seed=5, most=20, rounds=(16,), interim_tests=5)
    assert found.interim_tests == 5
    fine = next(s for s in found.scores if s.chain == FINE)
    assert fine.success_lower == pytest.approx((0.05 / 5) ** (1 / 20))
    with pytest.raises(ValueError, match="a test for each of 2 rounds"):
        race(post, ready, root_seed=5, most=20, rounds=(16,), interim_tests=1)


@pytest.mark.parametrize("rounds", [(0, 4), (8, 8), (9, 3)])
def test_rounds_must_rise(
    rounds: tuple[int, ...], post: LookCase, ready: PreparedRoutines
) -> None:
    with pytest.raises(ValueError, match="rise"):
        race(post, ready, root_seed=1, most=16, rounds=rounds)
