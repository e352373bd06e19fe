"""Grasps: force of bent fingers, angles a part settles in, what jaws would touch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from microplan.planner.assembly.assembly import with_part
from microplan.planner.assembly.shapes import squeeze_width_um
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.assembly.swept_volume import jaw_hits, report_jaws
from microplan.planner.budget.step_budget import report_handling
from microplan.planner.mechanics.gripping import (
    grasp_verdict,
    holding_un,
    widest_gap_rad,
)
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, read


@pytest.fixture(scope="module")
def job() -> tuple[Task, StepState]:
    task = read(EXAMPLE / "task.yaml")
    states = unfold(task, Report())
    return task, next(s for s in states if s.step.verb == "grasp")


def test_a_finger_bends_as_the_beam_equation_says(job: tuple[Task, StepState]) -> None:
    """E I w'' = F (L - x), w(0) = w'(0) = 0, solved apart from the closed form."""
    tool = job[0].workcell.tools["tweezers"]
    found = holding_un(tool, 2.0, 0.0)
    assert found is not None
    length = tool.free_length_um or 0.0
    stiff = (tool.youngs_modulus_gpa or 0.0) * 1e3  # uN/um2
    stiff *= tool.thickness_um * tool.finger_width_um**3 / 12

    def slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1], found[0] * length**2 * length * (1 - x) / stiff])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[1]])

    x = np.linspace(0, 1, 50)
    solved = solve_bvp(slopes, ends, x, np.zeros((2, 50)), tol=1e-8)
    assert solved.success
    assert solved.y[0, -1] == pytest.approx(2.0, rel=1e-5)


def test_without_a_stiffness_nothing_is_claimed(job: tuple[Task, StepState]) -> None:
    task, here = job
    tool = replace(task.workcell.tools["tweezers"], youngs_modulus_gpa=None)
    assert holding_un(tool, 2.0, 0.0) is None
    cell = replace(task.workcell, tools={"tweezers": tool})
    assert grasp_verdict(replace(task, workcell=cell), here).verdict == "unknown"


def test_a_grasp_holds_only_where_the_weakest_grip_lifts_the_strongest_hold(
    job: tuple[Task, StepState],
) -> None:
    task, here = job
    found = grasp_verdict(task, here)
    assert found.force_un is not None
    grip = [2 * task.environment.friction * force for force in found.force_un]
    wanted = "holds" if grip[0] >= found.lift_un[1] else "may slip"
    assert found.verdict == (wanted if grip[1] >= found.lift_un[0] else "will slip")
    firm = replace(task, environment=replace(task.environment, friction=10.0))
    assert grasp_verdict(firm, here).verdict == "holds"
    slick = replace(task, environment=replace(task.environment, friction=0.0))
    assert grasp_verdict(slick, here).verdict == "will slip"
    optics = replace(task.workcell.optics, medium_index=1.33)
    wet = replace(firm, workcell=replace(task.workcell, optics=optics))
    assert grasp_verdict(wet, here).verdict == "may slip"
    assert "double layers" in grasp_verdict(wet, here).reason


def test_the_finding_tells_room_width_and_angle(job: tuple[Task, StepState]) -> None:
    task, here = job
    found, report = grasp_verdict(task, here), Report()
    report_handling(here, found, None, report)
    (said,) = (d.message for d in report.found)
    assert report.found[0].severity == "note"
    tight, warned = replace(found, needed_um=found.room_um + 0.1), Report()
    report_handling(here, tight, None, warned)
    assert [(d.code, d.severity) for d in warned.found] == [("MP614", "warning")]
    assert f"{found.room_um:.3g} um beside it" in said
    assert f"{found.needed_um:.3g} um needed at 3 sigma" in said
    assert f"{found.width_range_um[0]:.4g}..{found.width_range_um[1]:.4g} um" in said
    assert f"within {1e3 * (found.theta_within_rad or 0.0):.3g} mrad" in said


def test_the_gear_settles_within_ten_degrees(job: tuple[Task, StepState]) -> None:
    """18 teeth on a round hull: minima every 20 degrees or closer."""
    task, here = job
    found = grasp_verdict(task, here)
    assert found.theta_within_rad is not None
    assert found.theta_within_rad <= math.radians(10.0) + 1e-9
    assert found.settles >= 9
    outline = task.parts["gear"].outline
    widths = [squeeze_width_um(outline, t) for t in np.linspace(0, math.pi, 721)]
    low, high = found.width_range_um
    assert low - 1e-6 <= min(widths)
    assert high + 1e-6 >= max(widths)
    assert min(widths) - low < 0.05  # a quarter of a degree from the minimum
    assert found.room_um >= found.needed_um * 2 / 3  # planned at 2 sigma
    assert found.squeeze_um > 0
    assert found.force_un is not None


def test_gaps_go_around_the_half_turn() -> None:
    assert widest_gap_rad((0.0,)) == pytest.approx(math.pi)
    assert widest_gap_rad((0.1, 1.0)) == pytest.approx(math.pi - 0.9)


def test_jaws_that_open_into_a_neighbour_are_refused(
    job: tuple[Task, StepState],
) -> None:
    task, here = job
    state, step = here.at_look, here.step
    assert jaw_hits(task, state, 96.0, "gear") == ()
    # the plate's post 15 um beside the left finger, which is 100 um wide
    left = -(state.opening_um / 2 + 100.0 + 15.0 + 22.0)
    plate = state.parts["shaft_plate"]
    pose = Pose(
        x_um=left + state.robot.x_um - state.stage.x_um,
        y_um=state.robot.y_um - state.stage.y_um,
    )
    beside = replace(
        with_part(state, "shaft_plate", replace(plate, pose=pose, sigma_xy_um=0.1)),
        pinned={"shaft_plate": 0.1},
    )
    assert jaw_hits(task, beside, 96.0, "gear") == ()
    report = Report()
    report_jaws(task, beside, step, 200.0, report)
    assert {(d.code, d.severity) for d in report.found} == {("MP303", "infeasible")}
    assert "tweezers.left" in report.found[0].message
