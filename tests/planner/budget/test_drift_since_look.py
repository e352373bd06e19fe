"""What moves after a look is charged to the insertion, and nothing else is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from microplan.planner.assembly.assembly import locate_place
from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.drift_since_look import drift_rows
from microplan.planner.source.diagnostics import Report
from microplan.schemas.plan import BudgetRow
from microplan.schemas.pose import Pose
from tests.planner.examples import change, copy_example, look_down_the_bore, read

SHAFT_LOOK = "  - {id: find_shaft,"
ROBOT_RAD = math.radians(23.56 / 3600)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the example that looks down the bore."""
    found = copy_example(tmp_path / "task")
    look_down_the_bore(found)
    return found


def sighted(name: str, step: str) -> PastMeasurement:
    return PastMeasurement(
        name=name,
        step=step,
        sigma_um=0.1,
        magnification=6.9,
        focus_um=0.0,
        distortion_sigma_um=0.0,
        coherence_um=0.0,
    )


def rows(
    file: Path, hole: str = "gear_in_fingers", shaft: str = "over_shaft"
) -> dict[str, BudgetRow]:
    """Return the terms since looks in the steps named."""
    task = read(file)
    states = unfold(task, Report())
    insert = next(s for s in states if s.step.id == "insert")
    seen = (sighted("gear.bore", hole), sighted("shaft_plate.post", shaft))
    return {row.term: row for row in drift_rows(task, states, insert, seen)}


def test_nothing_is_charged_where_nothing_moved_sideways(file: Path) -> None:
    assert rows(file) == {}  # the stage goes down only; its servo is a term of its own


def test_a_servo_moves_what_an_earlier_look_saw(file: Path) -> None:
    (row,) = rows(file, shaft="find_shaft").values()
    assert row.term == "stage moved since the look at shaft_plate.post"
    assert row.sigma_um == pytest.approx(math.sqrt(2) * 1.0)


def test_what_the_robot_carries_moves_and_swings_with_it(file: Path) -> None:
    aside = "{id: aside, do: move, move: [{robot: {x_um: 5}}, {robot: {theta_deg: 2}}]}"
    change(file, SHAFT_LOOK, f"  - {aside}\n{SHAFT_LOOK}")
    found = rows(file)
    moved = found.pop("robot moved since the look at gear.bore")
    assert moved.sigma_um == pytest.approx(math.sqrt(2) * 0.4)
    (swung,) = found.values()
    assert swung.term == "robot turned since the look at gear.bore"
    x_um, y_um = swing_of_the_bore(file)
    length_um = math.hypot(x_um, y_um)
    assert swung.sigma_um == pytest.approx(math.sqrt(2) * ROBOT_RAD * length_um)
    assert swung.along_rad is not None
    across = math.sin(swung.along_rad - math.atan2(y_um, x_um))
    assert across == pytest.approx(0.0, abs=1e-6)  # along the swing, either way


def swing_of_the_bore(file: Path) -> tuple[float, float]:
    """Return how the bore moves per radian of the robot, by turning its axis."""
    task = read(file)
    insert = next(s for s in unfold(task, Report()) if s.step.id == "insert")
    state = insert.before
    bore, robot = locate_place(task, state, "gear.bore").pose, state.robot
    grip = Pose(x_um=robot.x_um, y_um=robot.y_um, theta_rad=robot.theta_rad)
    tool = task.workcell.tools["tweezers"]
    back_um = 20800 - tool.grip_from_tip_um
    axis = grip.compose(Pose(x_um=0.0, y_um=back_um))
    arm = axis.inverse().apply(bore.x_um, bore.y_um)
    small = 1e-4
    sides = [
        Pose(x_um=axis.x_um, y_um=axis.y_um, theta_rad=axis.theta_rad + turn).apply(
            *arm
        )
        for turn in (-small, small)
    ]
    (x0, y0), (x1, y1) = sides
    return (x1 - x0) / (2 * small), (y1 - y0) / (2 * small)


def test_a_grasp_after_the_look_leaves_what_the_jaws_leave(file: Path) -> None:
    found = rows(file, hole="find_gear")
    assert (found["place of gear in the jaws"].sigma_um or 0.0) > 0
