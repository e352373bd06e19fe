"""Trials from image to outcome, on one worker and on several."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context

import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Artifact, Failure, Measurement
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.chains import chains
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.tolerance_search import usable_range
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    is_wrong,
    prepare,
    run,
    start,
)
from tests.featuresel.conftest import CASES

Look = Callable[[str], LookCase]


@cache
def prepared(name: str) -> PreparedRoutines:
    """Return all chains of a named look, ready for trials."""
    case = CASES[name]()
    return prepare(case, chains(case.target))


@pytest.mark.slow
def test_a_process_pool_gives_the_same_outcomes(look: Look) -> None:
    case = look("post")
    ready = prepare(case, chains(case.target))
    trials = design(case, 6, 1)
    serial = run(case, ready, trials)
    context = get_context("spawn")
    with ProcessPoolExecutor(max_workers=2, mp_context=context) as pool:
        assert run(case, ready, trials, map=pool.map) == serial
    assert len(serial) == 6 * len(ready.chains)


def test_fewer_chains_or_trials_change_no_outcome(look: Look) -> None:
    case, all_prepared = look("find_gear"), prepared("find_gear")
    whole = run(case, all_prepared, design(case, 4, 1))
    chain = all_prepared.chains[0]
    part = run(case, prepare(case, [chain]), design(case, 2, 1))
    assert part == whole.by(chain)[:2]


def test_outcomes_are_those_of_the_chain_the_executor_runs(look: Look) -> None:
    case, ready = look("find_gear"), prepared("find_gear")
    trial = design(case, 4, 1)[3]
    picture = image(case, trial)
    for outcome in run(case, ready, [trial]):
        artifacts = [ready.artifacts[name] for name in outcome.chain]
        able = [a for a in artifacts if isinstance(a, Artifact)]
        if len(able) < len(artifacts):
            assert outcome.failure == "not_prepared"
            continue
        stages = list(zip(outcome.chain, able, strict=True))
        found = measure_chain(picture, stages, start(case))
        if isinstance(found, Failure):
            assert outcome.failure == found.code
            continue
        assert isinstance(found, Measurement)
        assert outcome.world_um is not None
        x, y = case.frame.to_world(found.column, found.row)
        assert outcome.world_um[0] == x - case.x_um - trial.dx_um
        assert outcome.world_um[1] == y - case.y_um - trial.dy_um
        assert outcome.target_um is not None
        assert math.hypot(*outcome.target_um) == pytest.approx(outcome.distance_um)


def test_a_routine_that_cannot_be_prepared_fails_aloud(look: Look) -> None:
    case = look("bracket")  # the centroid of an L is no place to start from
    ready = prepare(case, [("otsu",), ("circle_caliper",)])
    assert isinstance(ready.artifacts["otsu"], Failure)
    outcomes = run(case, ready, design(case, 2, 1))
    assert {o.failure for o in outcomes} == {"not_prepared"}
    assert not any(is_wrong(case, o) for o in outcomes)


@pytest.mark.parametrize(
    "name",
    [
        "find_gear",
        *(
            pytest.param(n, marks=pytest.mark.slow)
            for n in ("between", "over_shaft", "jaws")
        ),
    ],
)
def test_each_look_of_the_job_finds_a_chain_without_silent_failures(
    name: str, look: Look
) -> None:
    case = look(name)
    limit = math.radians(1) if name == "find_gear" else None
    case, ready = replace(case, tolerance_theta_rad=limit), prepared(name)
    scores = score(case, ready, run(case, ready, design(case, 24, 1998)))
    found = select(scores, Constraints(tolerance_um=1.0, tolerance_theta_rad=limit))
    assert found.chosen is not None, found.advice
    assert found.chosen.success == 24
    assert found.chosen.need_um < 1.0
    assert (found.chosen.angles == 24) or limit is None


def test_focus_range_is_wider_for_a_looser_tolerance(look: Look) -> None:
    case = look("post")
    tight = replace(case, tolerance_um=0.02)
    ready = prepare(case, [("circle_caliper",)])
    wide = usable_range(case, ready, ("circle_caliper",), root_seed=1, draws=2)
    narrow = usable_range(tight, ready, ("circle_caliper",), root_seed=1, draws=2)
    assert wide.focus_um[0] <= narrow.focus_um[0] <= 0 <= narrow.focus_um[1]
    assert narrow.focus_um[1] <= wide.focus_um[1]
    assert wide.focus_um[1] >= 8
    assert wide.magnification[0] < 1 < wide.magnification[1]


@pytest.mark.slow
def test_a_process_pool_gives_the_same_range(look: Look) -> None:
    case = look("post")
    ready = prepare(case, [("circle_caliper",)])
    wide = usable_range(case, ready, ("circle_caliper",), root_seed=1, draws=2)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        again = usable_range(
            case, ready, ("circle_caliper",), root_seed=1, draws=2, map=pool.map
        )
    assert again == wide


def test_a_routine_that_never_answers_has_no_range(look: Look) -> None:
    case = look("bracket")
    ready = prepare(case, [("otsu",)])
    found = usable_range(case, ready, ("otsu",), root_seed=1)
    assert found.focus_um == (0.0, 0.0)
    assert found.magnification == (1.0, 1.0)
    with pytest.raises(ValueError, match="draws"):
        usable_range(case, ready, ("otsu",), root_seed=1, draws=0)
