"""The lower bound of a whole run, from made-up looks of the examples."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.compiling.keyed import write_task
from benchmarks.compiling.outline_shapes import d_shape
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.budget import EMPTY_BUDGET
from microplan.planner.budget.lower_bound.bounded_history import bounded
from microplan.planner.budget.lower_bound.run_bound import BoundedRun, success_bound
from microplan.planner.budget.lower_bound.step_bounds import (
    MeasuredStep,
    biases,
    measured_terms,
    success_share,
)
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.fit_angles import unfold_with_angles
from microplan.schemas.plan import Repeatability, Step, parse_plan
from tests.planner.examples import ROOT, down_the_bore, read
from tests.planner.placed import look, memory
from tests.planner.placed import read as read_die

GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"


@cache
def gear() -> tuple[Task, tuple[StepState, ...]]:
    task = read(down_the_bore())
    return task, unfold(task, Report())


@cache
def die() -> tuple[Task, tuple[StepState, ...]]:
    task = read_die()
    return task, unfold(task, Report())


def known(
    trials: int = 64, kurtosis: float = 3.0, undetected: int = 0, bias: float = 0.0
) -> Repeatability:
    return Repeatability(
        trials=trials, answered=trials - undetected, undetected=undetected,
        sigma_um=(0.1, 0.1), kurtosis=kurtosis, half_width_um=(bias, bias),
        kurtosis_theta=kurtosis, bias_theta_rad=0.0, half_width_theta_rad=1e-3 * bias,
    )  # fmt: skip


def insert(
    sigma_um: float,
    found: Repeatability,
    made: tuple[Task, tuple[StepState, ...]] | None = None,
    turn_rad: float | None = None,
) -> MeasuredStep:
    """Return the gear's insertion by looks of one accuracy."""
    task, states = made or gear()
    seen = {
        owner: replace(
            look(f"{owner}.x", step, sigma_um, sigma_theta_rad=turn_rad),
            repeatability=found,
        )
        for owner, step in (("gear", "gear_in_fingers"), ("shaft_plate", "over_shaft"))
    }
    history = MeasurementHistory(
        magnification=6.9, seen=seen, within_um=1.45, key="",
        before=replace(look("shaft_plate.post", "find_shaft", 0.4),
                       repeatability=found),
    )  # fmt: skip
    here = next(state for state in states if state.step.verb == "insert")
    return MeasuredStep(task=task, states=states, here=here, history=history)


def release(found: Repeatability) -> MeasuredStep:
    """Return the die's placement."""
    task, states = die()
    history = memory()
    seen = {k: replace(v, repeatability=found) for k, v in history.seen.items()}
    here = next(state for state in states if state.step.verb == "release")
    return MeasuredStep(
        task=task, states=states, here=here, history=replace(history, seen=seen)
    )


@settings(max_examples=6)
@given(
    sigma_um=st.floats(0.01, 1.5),
    trials=st.integers(8, 2000),
    tails=st.floats(1.5, 15),
    bias=st.floats(0, 0.5),
    doubt=st.floats(1e-4, 0.2),
)
def test_a_steps_bound_is_never_above_its_probability(
    sigma_um: float, trials: int, tails: float, bias: float, doubt: float
) -> None:
    step = insert(sigma_um, known(trials, tails, bias=bias))
    low = success_share(step, doubt)
    assert 0 <= low <= 1
    wider = insert(sigma_um, known(trials, tails, bias=bias + 0.2))
    assert success_share(wider, doubt) <= low + 2e-5  # as probabilities are averaged


def run(
    step: MeasuredStep, confidence: float = 0.95, chance: float = 0.997
) -> BoundedRun:
    """Return the gear example's plan with one step that may miss."""
    plan = parse_plan(GOLDEN.read_text(encoding="utf-8"))
    steps: list[tuple[Step, MeasuredStep]] = []
    for each in plan.steps:
        here = next((s for s in step.states if s.step.id == each.id), None)
        if here is None:  # a move that only the golden plan's task has
            continue
        budget = replace(EMPTY_BUDGET, success_probability=1.0)
        if each.verb == "insert":
            budget = replace(budget, success_probability=chance)
        told = step if each.verb == "insert" else replace(step, here=here)
        steps.append((replace(each, budget=budget), told))
    return BoundedRun(steps=tuple(steps), confidence=confidence)


def test_the_bound_comes_to_the_probability_as_trials_grow() -> None:
    few = run(insert(0.1, known(bias=0.03)))
    bounds = [success_bound(few.with_trials(4.0**k), None) for k in range(0, 13, 3)]
    lows = [bound.success_low for bound in bounds]
    assert lows == sorted(lows)
    assert lows[0] < bounds[0].reachable < 0.95  # what so few can show, the goal
    # a rate of 3.7 x 2.4 looks in 64 x 4**12 trials, a sigma known to 1e-4
    assert lows[-1] == pytest.approx(0.997, abs=1e-4)
    assert bounds[0].reachable == pytest.approx(1 - bounds[0].undetected_upper)
    assert bounds[0].terms == 9


def test_more_confidence_and_more_failures_lower_it() -> None:
    step = insert(0.1, known(bias=0.03))
    lows = [success_bound(run(step, c), None).success_low for c in (0.5, 0.9, 0.99)]
    assert lows == sorted(lows, reverse=True)
    found = run(step)
    look_ = found.steps[0][0].looks[0]
    measure = replace(look_.measure, repeatability=known(undetected=3))
    first = replace(found.steps[0][0], looks=(replace(look_, measure=measure),))
    worse = replace(found, steps=((first, found.steps[0][1]), *found.steps[1:]))
    bound = success_bound(worse, None)
    assert bound.undetected == 3
    assert bound.success_low < success_bound(found, None).success_low
    assert bound.reachable == success_bound(found, None).reachable


def test_it_says_how_many_trials_would_show_the_goal() -> None:
    found = run(insert(0.1, known(bias=0.03)))
    bound = success_bound(found, 0.95)
    assert bound.trials_needed is not None
    assert bound.success_low < 0.95 <= success_bound(
        found.with_trials(bound.trials_needed / bound.trials), 0.95
    ).success_low  # fmt: skip
    assert success_bound(found, 0.9975).trials_needed is None  # above P itself
    assert success_bound(found, 0.5).trials_needed == bound.trials
    assert success_bound(found, None).left_out == ()


def test_biases_add_up_and_a_plan_of_old_trials_is_taken_as_stated() -> None:
    found = success_bound(run(insert(0.1, known(bias=0.03))), None, ("grasp",))
    sides = [row.half_width_um for row in found.biases]
    assert len(sides) == 3
    assert min(sides) > math.hypot(0.03, 0.03)
    assert found.left_out == ("grasp",)
    step = insert(0.1, known())
    seen = {k: replace(v, repeatability=None) for k, v in step.history.seen.items()}
    old = replace(step, history=replace(step.history, seen=seen, before=None))
    assert success_share(old, 0.01) == 1.0


@pytest.mark.parametrize("answered", [0, 1])
def test_a_look_that_hardly_answers_shows_nothing(answered: int) -> None:
    none = replace(known(), answered=answered, sigma_um=(0.0, 0.0))
    bound = success_bound(run(insert(0.0, none)), None)
    assert bound.success_low == 0
    assert bound.biases == ()  # a plan holds no infinite number
    turned = look("part", "see", 0.0, sigma_theta_rad=0.0)
    assert bounded(replace(turned, repeatability=none), 0.01).sigma_theta_rad == 0


def test_coherence_is_a_bias_of_both_looks_together() -> None:
    step = insert(0.1, known())
    seen = {k: replace(v, coherence_um=0.2) for k, v in step.history.seen.items()}
    moved = replace(step, history=replace(step.history, seen=seen))
    rows = success_bound(run(moved), None).biases
    assert [r.half_width_um for r in rows if r.term == "partial coherence"] == [0.4]
    assert success_share(moved, 0.01) < success_share(step, 0.01)


def test_an_insertion_of_outlines_has_the_ends_of_its_angles_too(
    tmp_path: Path,
) -> None:
    bore, post = d_shape(25.0, 16.0), d_shape(21.0, 13.0)
    keyed = unfold_with_angles(
        read(write_task(tmp_path / "task", bore, post)), Report()
    )
    found = replace(known(), bias_theta_rad=0.003, half_width_theta_rad=0.001)
    step = insert(0.1, found, keyed, turn_rad=0.01)
    assert measured_terms([step]) == 3 * 3 + 2 * 2
    assert measured_terms([insert(0.1, found)]) == 3 * 3  # a circle has no angle
    rows = [row for row in biases(step, 0.05) if row.term.startswith("angle of")]
    # no point of the post is farther than its radius of 21 um, and the corners at the
    # flat are as far
    assert [row.half_width_um for row in rows] == pytest.approx(
        [21 * 0.004] * 2, rel=0.01
    )
    assert [*biases(insert(0.1, found), 0.05)][3:] == []


def test_a_placement_has_the_ends_of_its_angles_too() -> None:
    step = release(known())
    assert step.is_measured
    assert not replace(step, here=step.states[0]).is_measured
    share = success_share(step, 0.01)
    wide = success_share(release(known(bias=0.05)), 0.01)
    assert 0 < wide < share <= 1
