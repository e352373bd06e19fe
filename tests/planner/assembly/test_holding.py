"""How a part stands between the jaws, and how it lies once they have closed."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from scipy import stats

from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.planner.assembly import holding
from microplan.planner.assembly.assembly import Axis4, State, bodies, with_part
from microplan.planner.assembly.holding import between_jaws, grasp, rests_of, turn_miss
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.shapes import CHORD_UM, polygon
from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.budget import grasp_budget
from microplan.planner.plan.actions import action_of
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.schemas.plan import GraspAction
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, read


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


def grasp_step(task: Task) -> TaskStep:
    return next(step for step in task.steps if step.verb == "grasp")


def standing(
    task: Task, x_um: float, turn_rad: float, *, tool_rad: float = 0.0
) -> State:
    """Return a state with the gear `x_um` off between the jaws, both turned."""
    state = initial(task)
    pose = Pose(x_um=0.0, y_um=0.0, theta_rad=tool_rad).compose(
        Pose(x_um=x_um, y_um=0.0, theta_rad=turn_rad)
    )
    part = replace(
        state.parts["gear"], pose=pose, sigma_xy_um=5.0, sigma_theta_rad=0.01
    )
    return replace(
        with_part(state, "gear", part),
        stage=Axis4(),
        robot=Axis4(z_um=30.0, theta_rad=tool_rad),
    )


def with_angle(task: Task) -> Task:
    """Return a task whose gear is aligned by its angle, on axes that turn exactly."""
    axes = replace(task.workcell.stage.axes, repeatability_theta_rad=0.0)
    robot = replace(task.workcell.robot.axes, repeatability_theta_rad=0.0)
    cell = replace(
        task.workcell,
        stage=replace(task.workcell.stage, axes=axes),
        robot=replace(task.workcell.robot, axes=robot),
    )
    steps = tuple(
        replace(step, tolerance_theta_rad=0.02) if step.id == "over_shaft" else step
        for step in task.steps
    )
    return replace(task, workcell=cell, steps=steps)


def test_a_grasp_leaves_what_the_jaws_do_not_take_away(task: Task) -> None:
    """The gear lies 3 degrees off flat, a tenth of that uncertain: one minimum only."""
    robot_rad = task.workcell.robot.axes.repeatability_theta_rad
    state, step = standing(task, 0.0, math.radians(7)), grasp_step(task)
    held = grasp(task, state, step, Report()).parts["gear"]
    assert held.sigma_theta_rad == pytest.approx(robot_rad, rel=1e-6)
    loose = replace(state.parts["gear"], sigma_theta_rad=math.radians(20))
    held = grasp(task, with_part(state, "gear", loose), step, Report()).parts["gear"]
    # minima 20 degrees apart: rounding adds a twelfth of their square
    wanted = math.hypot(math.radians(20), math.radians(20) / math.sqrt(12))
    around = math.radians(3)  # the nearest is 3 degrees from the mean
    assert held.sigma_theta_rad == pytest.approx(math.hypot(wanted, around), rel=0.02)


@pytest.mark.parametrize(
    ("start_deg", "sigma_deg", "refused"),
    [(0.0, 0.5, True), (0.0, 0.0, False), (10.0, 1.0, False), (5.0, 2.0, True)],
)
def test_jaws_that_may_turn_a_part_either_way_are_refused_if_its_angle_is_needed(
    task: Task, start_deg: float, sigma_deg: float, refused: bool
) -> None:
    """An 18-tooth gear lies flat every 20 degrees, 10 degrees off its drawing."""
    needed = with_angle(task)
    state = standing(task, 0.0, math.radians(start_deg))
    part = replace(state.parts["gear"], sigma_theta_rad=math.radians(sigma_deg))
    state = with_part(state, "gear", part)
    for steps, told in ((task.steps, False), (needed.steps, refused)):
        report = Report()
        grasp(replace(needed, steps=steps), state, grasp_step(task), report)
        assert ("MP310" in [found.code for found in report.found]) == told


@pytest.mark.parametrize(
    ("start_deg", "sigma_deg"), [(5.0, 2.0), (10.0, 3.0), (13.0, 2.5), (10.0, 0.5)]
)
def test_p_of_a_grasp_counts_another_angle_than_planned_if_that_is_needed(
    task: Task, start_deg: float, sigma_deg: float
) -> None:
    """The gear turns to 10 degrees from between 0 and 20, a start beyond elsewhere."""
    needed = with_angle(task)
    state, step = standing(task, 0.0, math.radians(start_deg)), grasp_step(task)
    part = replace(state.parts["gear"], sigma_theta_rad=math.radians(sigma_deg))
    state = with_part(state, "gear", part)
    start = stats.norm(start_deg, sigma_deg)
    missed = start.cdf(0.0) + start.sf(20.0)
    assert turn_miss(needed, state, step) == pytest.approx(missed, rel=1e-5, abs=1e-12)
    assert turn_miss(task, state, step) is None
    turned, free = (
        grasp_budget(replace(needed, steps=steps), state, step).success_probability
        for steps in (needed.steps, task.steps)
    )
    assert turned == pytest.approx(free * (1 - missed), abs=1e-9)


RECTANGLE = ((-43.0, -59.0), (55.0, -59.0), (55.0, 51.0), (-43.0, 51.0))
TRIANGLE = ((-10.0, -20.0), (90.0, -20.0), (15.0, 60.0))


@pytest.mark.parametrize("corners", [RECTANGLE, TRIANGLE])
def test_a_part_at_a_rest_angle_is_narrowest_and_amid_the_jaws(
    corners: tuple[tuple[float, float], ...],
) -> None:
    ends = (*corners[1:], corners[0])
    edges = tuple(Segment(start=a, end=b) for a, b in zip(corners, ends, strict=True))
    rests = rests_of(Outline(rings=(Ring(edges=edges),)))

    def along_x(turn: float) -> tuple[float, float]:
        x = [math.cos(turn) * u - math.sin(turn) * v for u, v in corners]
        return min(x), max(x)

    angles = [rest.theta_rad for rest in rests]
    assert angles == sorted(angles)
    assert len(rests) == 2 * {4: 2, 3: 3}[len(corners)]  # a triangle has three heights
    for rest in rests:
        low, high = along_x(rest.theta_rad)
        assert low + rest.across_um == pytest.approx(-high - rest.across_um, abs=1e-3)
        for by in (-0.01, 0.01):
            beside_low, beside_high = along_x(rest.theta_rad + by)
            assert beside_high - beside_low > high - low


def test_the_plan_has_where_the_gear_comes_to_rest(task: Task) -> None:
    """18 teeth, a gap at 0: every 20 degrees, 10 degrees off the drawing."""
    here = next(s for s in unfold(task, Report()) if s.step.verb == "grasp")
    action = action_of(task, here, ())
    assert isinstance(action, GraspAction)
    degrees = [math.degrees(rest.theta_rad) for rest in action.rests]
    assert degrees == pytest.approx([20 * k + 10 for k in range(18)], abs=1e-4)
    assert [rest.across_um for rest in action.rests] == [0.0] * 18


def test_what_jaws_do_not_turn_has_no_rest_angles() -> None:
    whole = Arc(center=(3.0, 0.0), radius_um=50.0, start_rad=0.0, sweep_rad=math.tau)
    assert rests_of(Outline(rings=(Ring(edges=(whole,)),))) == ()


@pytest.mark.parametrize("tool_rad", [0.0, 0.7])
@pytest.mark.parametrize("turn_deg", [3.0, 17.0])
def test_jaws_stop_at_the_outline_of_the_part_that_they_hold(
    task: Task, turn_deg: float, tool_rad: float
) -> None:
    """They are sent to 96 um, and the gear is wider: they touch it, and no more."""
    state = standing(task, 4.0, math.radians(turn_deg), tool_rad=tool_rad)
    held = grasp(task, state, grasp_step(task), Report())
    shapes = {body.name: polygon(body.outline) for body in bodies(task, held)}
    gear = shapes["gear"]
    for side in ("left", "right"):
        finger = shapes[f"tweezers.{side}"]
        assert gear.distance(finger) < CHORD_UM
        assert gear.intersection(finger).area < 1e-3
    assert held.opening_um > 96


@pytest.mark.parametrize("x_um", [0.0, 8.0, -12.0])
@pytest.mark.parametrize("tool_rad", [0.0, 0.7, math.pi / 2])
def test_the_budget_of_a_grasp_is_that_of_its_check(
    task: Task, x_um: float, tool_rad: float
) -> None:
    state = standing(task, x_um, math.radians(3), tool_rad=tool_rad)
    step = grasp_step(task)
    width_um = 100 * math.cos(math.radians(6))  # on two neighbouring tips either side
    stands = between_jaws(task, state, step)
    assert stands.width_um == pytest.approx(width_um, abs=0.04)  # chords of arcs
    assert stands.local.x_um == pytest.approx(x_um, abs=1e-9)
    half_um = (130 - stands.width_um) / 2
    budget = grasp_budget(task, state, step)
    assert budget.limit_um == pytest.approx(half_um - abs(x_um))
    swing_um = 20800 * math.radians(23.56 / 3600)  # nothing has seen the tool yet
    sigma_um = math.hypot(5.0, 1.0, 0.4, swing_um)  # stage, robot
    place = stats.norm(x_um, sigma_um)
    assert budget.success_probability == pytest.approx(
        place.cdf(half_um) - place.cdf(-half_um), abs=1e-12
    )


@pytest.mark.parametrize("noise_rad", [0.0, 1e-12, -1e-12])
def test_midway_between_two_turns_jaws_close_on_the_clockwise_one(
    noise_rad: float,
) -> None:
    """As the example's gear lies: 18 teeth, a flank at 10 degrees to either side."""
    turns = (math.radians(10), math.radians(-10))
    assert holding._nearest(turns, noise_rad) == pytest.approx(-math.radians(10))
