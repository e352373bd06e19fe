"""Which way an alignment is run, and that the task's own word counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.control import control_of, tolerance_um
from microplan.planner.budget.insert_budget import share_of_goal
from microplan.planner.budget.methods import choose, method_of
from microplan.planner.source.diagnostics import Report
from microplan.schemas.plan.verdicts import MethodChoice, MethodName, MethodOption
from tests.planner.examples import change, copy_example, look_down_the_bore, read


def option(method: MethodName, chance: float | None, seconds: float) -> MethodOption:
    return MethodOption(
        method=method, success_probability=chance, looks=1.0, expected_s=seconds
    )


@pytest.mark.parametrize(
    ("servo", "single", "wanted", "said"),
    [
        ((0.99, 1.0), (0.98, 0.3), "look_then_move", "quickest to meet"),
        ((0.99, 1.0), (0.90, 0.3), "servo", "meets"),
        ((0.80, 1.0), (0.70, 0.3), "servo", "nearest"),
        ((0.80, 1.0), (0.80, 0.3), "look_then_move", "nearest"),
        ((None, 1.0), (None, 0.3), "servo", "no insertion follows"),
    ],
)
def test_the_quickest_that_is_good_enough_is_taken(
    servo: tuple[float | None, float],
    single: tuple[float | None, float],
    wanted: str,
    said: str,
) -> None:
    options = (option("servo", *servo), option("look_then_move", *single))
    found = choose(options, 0.95, "insert")
    assert found.method == wanted
    assert said in found.reason
    assert found.options == options


def test_nothing_to_choose_from_is_an_error() -> None:
    with pytest.raises(ValueError, match="option"):
        choose((), 0.95)


def method(file: Path) -> tuple[MethodChoice, Report]:
    """Return how the example's alignment over the shaft is run."""
    task, report = read(file), Report()
    states = unfold(task, Report())
    align = next(s for s in states if s.step.id == "over_shaft")
    within = tolerance_um(task, states, align, None)
    found = method_of(task, states, align, within, {}, report)
    control = control_of(task, align, within, found)
    assert control.method == found.method
    assert control.floor_s is not None
    assert control.floor_s <= control.approach_s + control.expected_s
    assert control.ratio_to_floor is not None
    assert 1.0 <= control.ratio_to_floor < 2.0
    return found, report


def test_a_stage_that_one_look_is_not_enough_for_servoes(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    look_down_the_bore(file)
    found, report = method(file)
    chances = {o.method: o.success_probability for o in found.options}
    goal = share_of_goal(read(file))
    assert goal == pytest.approx(0.95 ** (1 / 3))  # grasp, insert, release
    assert chances["servo"] is not None
    assert chances["look_then_move"] is not None
    assert chances["servo"] > chances["look_then_move"]
    assert found.method == "servo"
    assert [d.code for d in report.found] == ["MP612"]


def test_the_robot_repeats_well_enough_for_one_look(tmp_path: Path) -> None:
    found, _ = method(copy_example(tmp_path / "task"))
    assert found.method == "look_then_move"
    chance = {o.method: o.success_probability for o in found.options}[found.method]
    assert chance is not None
    assert chance > 0.95 ** (1 / 3)


def test_a_fine_stage_needs_one_look_only(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    look_down_the_bore(file)
    cell = file.with_name("workcell.yaml")
    change(cell, "repeatability_xy_um: 1.0", "repeatability_xy_um: 0.3")
    assert method(file)[0].method == "look_then_move"
    change(file, "method: auto", "method: servo")
    found, report = method(file)
    assert (found.method, found.asked) == ("servo", "servo")
    assert report.found == []
