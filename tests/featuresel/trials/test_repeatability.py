"""Repeatability of chains on fresh random trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.featuresel.look.design import random_design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.repeatability import from_stops, repeatability
from microplan.featuresel.trials.score import ChainScore, score_chain
from microplan.featuresel.trials.trials import prepare, run

Look = Callable[[str], LookCase]
CHAIN, SPARE = ("circle_caliper",), ("otsu",)


def test_it_is_the_score_of_random_trials_alone(look: Look) -> None:
    case = look("post")
    case = replace(case, stated=replace(case.spread, focus_sigma_um=0.5))
    ready = prepare(case, [CHAIN, SPARE])
    found = repeatability(case, ready, (CHAIN, SPARE), count=12, root_seed=3)
    alone = replace(ready, chains=(CHAIN,))
    outcomes = run(case, alone, random_design(case, 12, 3))
    assert found.outcomes.by(CHAIN) == outcomes
    errors = np.array([o.target_um for o in outcomes])
    assert found.of(CHAIN).sigma_um == pytest.approx(errors.std(axis=0, ddof=1).max())
    assert found.of(CHAIN).trials == found.of(SPARE).trials == 12
    with pytest.raises(ValueError, match="not tried"):
        found.of(("ncc",))


def test_what_one_stop_does_not_show_is_looked_for_from_the_next(look: Look) -> None:
    """A height far off: the stop on its side shows it, one on the other side none."""
    case = look("post")
    low = replace(case.spread, focus_sigma_um=200.0, light_gain=(1.0, 1.0))
    case = replace(case, stated=low)
    ready = prepare(case, [CHAIN])
    trials = random_design(case, 12, 3)

    def missed(*stops_um: float) -> set[int]:
        found = repeatability(
            case, ready, (CHAIN,), count=12, root_seed=3, stops_um=stops_um
        )
        assert [o.trial for o in found.outcomes] == list(range(12))
        return {o.trial for o in found.outcomes if o.failure is not None}

    lost = missed()
    above = max(lost, key=lambda k: trials[k].dz_um)
    to_focus_um = -trials[above].dz_um
    assert to_focus_um < -100.0
    assert above in missed(-to_focus_um)
    later = missed(-to_focus_um, to_focus_um)
    assert above not in later
    assert later < lost


def test_further_stops_are_of_the_same_trial_with_other_noise(look: Look) -> None:
    trial = random_design(look("post"), 1, 3)[0]
    first, second = from_stops(trial, (7.0,))
    assert first == trial
    assert second == replace(trial, dz_um=trial.dz_um + 7.0, seed=second.seed)
    assert second.seed != trial.seed


def answer(trial: int, x: float, y: float, *, corner: bool) -> Outcome:
    return Outcome(
        chain=CHAIN, trial=trial, world_um=(x, y), target_um=(x, y), theta_rad=0.1 * x,
        score=1.0, spread_um=0.01, z_um=x, zoom=y, corner=corner,
    )  # fmt: skip


STATISTICS = (
    "bias_um", "sigma_um", "bias_theta_rad", "sigma_theta_rad", "x", "y", "theta", "z",
    "zoom", "spread_x", "spread_y", "spread_theta", "need_upper_um",
)  # fmt: skip
ERRORS = st.tuples(st.floats(-5, 5), st.floats(-5, 5))


def test_corners_change_no_statistic_of_errors(look: Look) -> None:
    """They count as tried; that is all: whatever they err by."""
    case = look("post")

    def scored(outcomes: list[Outcome]) -> ChainScore:
        return score_chain(case, CHAIN, Outcomes.of(outcomes), 1.0)

    @settings(max_examples=40)
    @given(st.lists(ERRORS, min_size=2, max_size=9), st.lists(ERRORS, max_size=9))
    def hold(
        random: list[tuple[float, float]], corners: list[tuple[float, float]]
    ) -> None:
        drawn = [answer(k, *e, corner=False) for k, e in enumerate(random)]
        more = [answer(k + 100, *e, corner=True) for k, e in enumerate(corners)]
        without, found = scored(drawn), scored([*more, *drawn])
        for name in STATISTICS:
            assert getattr(found, name) == getattr(without, name), name
        assert found.trials == len(random) + len(corners)
        assert found.success >= without.success

    hold()
