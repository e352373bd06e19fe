"""Insertions as the plan has them: what moved last decides budget and retreat."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from microplan.planner.assembly.assembly import part_sigma_um
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.alignment_residual import residual_of
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.control import control_of, tolerance_um
from microplan.planner.budget.insert_budget import apart
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.budget.methods import method_of
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.plan.steps import CompiledStep, compile_step
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import check_tolerances, gain_of, moved_by
from microplan.schemas.plan import AxisMove
from tests.planner.examples import change, copy_example, look_down_the_bore, read

WITHIN_UM = 1.5
INSERT = "  - {id: insert, "
STAGE_UM, ROBOT_UM = 1.0, 0.4  # repeatabilities of the example's workcell


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the example that looks down the bore: the stage aligns."""
    found = copy_example(tmp_path / "task")
    look_down_the_bore(found)
    return found


# at what the alignment moves, before it: finer than the robot
FINE_LOOK = PastMeasurement(
    name="gear.bore",
    step="gear_in_fingers",
    sigma_um=0.05,
    magnification=6.9,
    focus_um=0.0,
    distortion_sigma_um=0.0,
    coherence_um=0.0,
)


def by_robot(file: Path) -> None:
    """Let the robot lift, align and lower the gear, and the stage stand still."""
    change(file, "move: [{stage: {z_um: -260}}]", "move: [{robot: {z_um: 290}}]")
    change(file, "target: shaft_plate.post, to: gear.bore, method",
           "target: gear.bore, to: shaft_plate.post, method")  # fmt: skip
    change(
        file, "move: [{stage: {z_um: 0}}], speed", "move: [{robot: {z_um: 30}}], speed"
    )


def unfolded(file: Path) -> tuple[Task, tuple[StepState, ...]]:
    task = read(file)
    return task, unfold(task, Report())


def named(states: tuple[StepState, ...], name: str) -> StepState:
    return next(s for s in states if s.step.id == name)


def inserted(file: Path) -> CompiledStep:
    """Return the compiled insertion; it has no look, so no image is made."""
    task, states = unfolded(file)
    memory = MeasurementHistory(
        magnification=6.9, seen={}, within_um=WITHIN_UM, key="", before=FINE_LOOK
    )
    effects = CompileContext(effort=PRESETS["fast"], max_image_error=0.002, map=map)
    index = states.index(named(states, "insert"))
    found = compile_step(task, states, index, memory, effects, Report())
    assert found is not None
    return found


def test_the_stage_inserts_with_its_own_tilt_and_goes_back_by_itself(
    file: Path,
) -> None:
    step = inserted(file).step
    rows = {row.term: row for row in step.budget.rows}
    assert rows["stage axis tilt over the travel"].sigma_um == pytest.approx(0.52)
    assert "stage place left by the servo" in rows
    assert step.conditions.retreat == (AxisMove(axes="stage", z_um=-260.0),)


def test_the_robot_inserts_with_its_own_tilt_and_goes_back_by_itself(
    file: Path,
) -> None:
    by_robot(file)
    step = inserted(file).step
    rows = {row.term: row for row in step.budget.rows}
    assert not any("stage" in term for term in rows)
    tilt = rows["robot axis tilt over the travel"]
    assert tilt.sigma_um is None  # nobody states it
    assert "not modelled" in tilt.source
    assert "260 um" in tilt.source
    left = rows["robot place left by the servo"].sigma_um
    assert left is not None
    assert 0 < left <= ROBOT_UM * math.sqrt(2)
    assert step.conditions.retreat == (AxisMove(axes="robot", z_um=290.0),)


def test_the_way_back_is_the_way_in_backwards(file: Path) -> None:
    moves = "{stage: {z_um: -100}}, {robot: {z_um: 25}}, {stage: {z_um: -5}}"
    change(file, "move: [{stage: {z_um: 0}}]", f"move: [{moves}]")
    assert inserted(file).step.conditions.retreat == (
        AxisMove(axes="stage", z_um=-100.0),
        AxisMove(axes="robot", z_um=40.0),
        AxisMove(axes="stage", z_um=-260.0),
    )


def test_an_alignment_by_the_robot_is_as_fine_as_the_robot(file: Path) -> None:
    by_robot(file)
    task, states = unfolded(file)
    align, report = named(states, "over_shaft"), Report()
    assert moved_by(task, align) == "robot"
    residual = residual_of(task, WITHIN_UM, "robot")
    gain = gain_of(task)
    assert residual.sigma_um == pytest.approx(ROBOT_UM * math.sqrt(2 / (2 - gain)))
    coarse = residual_of(task, WITHIN_UM, "stage")
    assert coarse.sigma_um == pytest.approx(residual.sigma_um * STAGE_UM / ROBOT_UM)
    change(file, "to: shaft_plate.post, method", "to: shaft_plate.post, "
           "tolerance_xy_um: 0.3, method")  # fmt: skip
    task, states = unfolded(file)
    align = named(states, "over_shaft")
    # hopeless for the stage, no trouble for the robot
    assert tolerance_um(task, states, align, None) == 0.3
    assert check_tolerances(task, states, report)
    assert report.found == []


def test_fingers_led_by_the_robot_pass_as_close_as_the_robot_repeats(
    file: Path,
) -> None:
    """Beside a gear of 50 +- 10 um there is 1.5 um: enough for 0.8, not for 2."""
    change(file, "sigma_xy_um: 30", "sigma_xy_um: 4.9")  # and the stage's 1: 5.0
    change(file, "x_um: 0, y_um: 3000, z_um: 400, opening_um: 130",
           "x_um: 400, y_um: 3000, z_um: 30, opening_um: 123")  # fmt: skip
    change(file, "target: tweezers, move: [{stage: {y_um: -250}}, {robot: {x_um: 0, "
           "y_um: 0}}, {robot: {z_um: 40}}]", "target: tweezers")  # fmt: skip
    change(file, "target: gear, to: tweezers.grip", "target: tweezers.grip, to: gear")
    report = Report()
    states = unfold(read(file), report)
    assert named(states, "bring_between").path == ("x", "y")
    assert "'bring_between'" not in " ".join(d.message for d in report.found)


def test_a_move_after_the_alignment_is_not_budgeted_as_aligned(file: Path) -> None:
    aside = "{id: aside, do: move, move: [{stage: {x_um: 90}}, {stage: {x_um: 0}}]}"
    good = inserted(file).step.budget.success_probability
    change(file, INSERT, f"  - {aside}\n{INSERT}")
    _, states = unfolded(file)
    budget = inserted(file).step.budget
    assert budget.rows[0].term == "places of both parts"
    before = named(states, "insert").before
    spread = [part_sigma_um(before, name) for name in ("gear", "shaft_plate")]
    assert budget.rows[0].sigma_um == pytest.approx(math.hypot(*spread), rel=1e-3)
    assert budget.success_probability < 0.1 < 0.9 < good


@pytest.mark.parametrize("off_um", [1.0, 5.0])
def test_what_the_moves_leave_off_the_post_counts(file: Path, off_um: float) -> None:
    """The gear is let down beside the post, as far off as the move says."""
    down = "{stage: {z_um: 0}}"
    sideways = f"{{stage: {{x_um: {off_um}}}}}"
    change(file, f"move: [{down}]", f"move: [{sideways}, {down}]")
    rows = {row.term: row for row in inserted(file).step.budget.rows}
    assert rows["offset that the moves leave"].sigma_um == pytest.approx(off_um)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("gear.bore, method: auto", "gear.bore, tolerance_xy_um: 0.0001"),
        ("gear.bore, method: auto", "gear.bore, tolerance_theta_deg: 0.000001"),
        ("speed_um_per_s: 20", "speed_um_per_s: 0.001"),
    ],
)
def test_the_least_that_a_task_may_state_is_worked_out(
    file: Path, old: str, new: str
) -> None:
    """Beside axes that repeat to 10 mm, and drift by 10 mm a minute."""
    cell = file.with_name("workcell.yaml")
    change(cell, "repeatability_xy_um: 1.0 ", "repeatability_xy_um: 10000 ")
    change(cell, "drift_um_per_min: 0.1 ", "drift_um_per_min: 10000 ")
    change(file, old, new)
    task, states = unfolded(file)
    align = named(states, "over_shaft")
    within_um = tolerance_um(task, states, align, None)
    choice = method_of(task, states, align, within_um, {}, Report())
    control = control_of(task, align, within_um, choice)
    assert math.isfinite(control.expected_cycles)
    assert control.max_cycles >= control.expected_cycles
    chance = inserted(file).step.budget.success_probability
    assert 0 <= chance < 1e-3
    change(file, new, new[:-1] + "01")
    assert load_task(str(file), Report()) is None


def test_an_offset_keeps_its_direction(file: Path) -> None:
    """The plate goes to -x and +y, so that the gear comes down to +x and -y of it."""
    down = "{stage: {z_um: 0}}"
    task, states = unfolded(file)
    stage = named(states, "insert").after.stage
    there = f"{{stage: {{x_um: {stage.x_um - 3}, y_um: {stage.y_um + 4}}}}}"
    change(file, f"move: [{down}]", f"move: [{there}, {down}]")
    task, states = unfolded(file)
    state = named(states, "insert").after
    off_um, way_rad = apart(task, state, "gear.bore", "shaft_plate.post")
    assert off_um == pytest.approx(5.0)
    assert way_rad == pytest.approx(math.atan2(-4, 3))
