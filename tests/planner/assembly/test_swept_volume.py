"""What a move would touch: heights, spreads, and bodies that only part."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from microplan.planner.assembly.assembly import Axis4, PartState, State
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.swept_volume import SURFACE, Hit, sweep_hits
from microplan.planner.task.task import Task
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, read

FINGER_UM, GEAR_UM = 100.0, 50.0  # a finger's width, the gear's radius
STAGE_UM = 1.0  # repeatabilities of the example's axes, xy
# an unseen grip swings about its axis besides: 23.56 arcsec, 20.8 mm
ROBOT_UM = math.hypot(0.4, 20800 * math.radians(23.56 / 3600))
ROBOT_Z_UM = 8.0


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


def jaws_over_gear(task: Task, z_um: float, opening_um: float = 130.0) -> State:
    """Return the gear on the axis, well known, the open jaws `z_um` high around it."""
    start = initial(task)
    gear = replace(start.parts["gear"], sigma_xy_um=0.0)
    return replace(
        start,
        stage=Axis4(x_um=-600),
        robot=Axis4(z_um=z_um),
        opening_um=opening_um,
        parts={**start.parts, "gear": gear},
    )


def held(task: Task, state: State) -> State:
    """Return the state with the gear in the jaws, where it lies."""
    gear = PartState(
        carrier="robot",
        pose=Pose(x_um=0.0, y_um=0.0),
        z_um=-state.robot.z_um,
        sigma_xy_um=0.0,
        sigma_z_um=1.0,
        sigma_theta_rad=math.pi,
    )
    return replace(state, held="gear", parts={**state.parts, "gear": gear})


def robot_to(task: Task, state: State, **to: float) -> tuple[Hit, ...]:
    after = replace(state, robot=replace(state.robot, **to))
    return sweep_hits(task, state, after, carrier="robot")


def stage_to(task: Task, state: State, **to: float) -> tuple[Hit, ...]:
    after = replace(state, stage=replace(state.stage, **to))
    return sweep_hits(task, state, after, carrier="stage")


def pairs(hits: tuple[Hit, ...]) -> set[tuple[str, str]]:
    return {(hit.moving, hit.still) for hit in hits}


def test_open_jaws_come_down_beside_the_gear(task: Task) -> None:
    assert robot_to(task, jaws_over_gear(task, 400.0), z_um=30.0) == ()


def test_closed_jaws_come_down_on_the_gear(task: Task) -> None:
    hits = robot_to(task, jaws_over_gear(task, 400.0, opening_um=90.0), z_um=30.0)
    both = {("tweezers.left", "gear"), ("tweezers.right", "gear")}
    assert pairs(hits) == both
    assert {hit.gap_um for hit in hits} == {0.0}


def test_the_gap_and_the_spread_are_those_of_the_drawing(task: Task) -> None:
    opening_um = 103.0
    hits = robot_to(task, jaws_over_gear(task, 400.0, opening_um), z_um=30.0)
    spread_um = 2 * math.hypot(STAGE_UM, ROBOT_UM)
    assert len(hits) == 2
    for hit in hits:
        # a tooth points along -x as along +x: 18 is even
        assert hit.gap_um == pytest.approx(opening_um / 2 - GEAR_UM, abs=0.02)
        assert hit.needed_um == pytest.approx(spread_um)


@pytest.mark.parametrize(("margin_um", "touches"), [(-0.1, True), (0.1, False)])
def test_clearance_is_needed_at_two_sigma(
    task: Task, margin_um: float, *, touches: bool
) -> None:
    spread_um = 2 * math.hypot(STAGE_UM, ROBOT_UM)
    state = jaws_over_gear(task, 400.0, 2 * (GEAR_UM + spread_um + margin_um))
    assert bool(robot_to(task, state, z_um=30.0)) is touches


@pytest.mark.parametrize(("margin_um", "touches"), [(-0.1, True), (0.1, False)])
def test_passing_above_needs_two_sigma_of_height(
    task: Task, margin_um: float, *, touches: bool
) -> None:
    gear_top_um = 100.0
    z_um = gear_top_um + 2 * math.hypot(ROBOT_Z_UM, 1.0) + margin_um
    state = replace(
        jaws_over_gear(task, z_um, opening_um=90.0), robot=Axis4(x_um=900, z_um=z_um)
    )
    assert bool(robot_to(task, state, x_um=0.0)) is touches


def test_what_lies_between_start_and_end_is_hit(task: Task) -> None:
    state = replace(jaws_over_gear(task, 30.0), robot=Axis4(x_um=600, z_um=30.0))
    assert robot_to(task, state, x_um=700.0) == ()
    across = replace(state, stage=Axis4(x_um=-200))
    assert ("tweezers.left", "gear") in pairs(robot_to(task, across, x_um=1200.0))


def test_bodies_that_touch_may_part_but_not_press(task: Task) -> None:
    state = held(task, jaws_over_gear(task, 30.0, opening_um=96.0))
    assert stage_to(task, state, z_um=-260.0) == ()
    assert pairs(stage_to(task, state, z_um=10.0)) >= {("gear", SURFACE)}
    assert pairs(stage_to(task, state, x_um=0.0)) >= {("gear", SURFACE)}  # dragged


def test_the_stage_is_not_raised_into_the_tool(task: Task) -> None:
    needed_um = 2 * math.hypot(ROBOT_Z_UM, 1.0)
    state = replace(jaws_over_gear(task, 30.0), stage=Axis4(x_um=2000, z_um=-100))
    assert stage_to(task, state, z_um=30 - needed_um - 0.1) == ()
    hits = stage_to(task, state, z_um=30 - needed_um + 0.1)
    both = {("tweezers.left", SURFACE), ("tweezers.right", SURFACE)}
    assert pairs(hits) == both


def test_a_pair_that_is_meant_to_touch_is_exempt(task: Task) -> None:
    state = held(task, jaws_over_gear(task, 30.0, opening_um=96.0))
    low = replace(state, stage=Axis4(z_um=-260))
    up = replace(state, stage=Axis4())
    pair = frozenset({frozenset({"gear", "shaft_plate"})})
    hits = sweep_hits(task, low, up, carrier="stage")
    assert ("shaft_plate", "gear") in pairs(hits)
    assert sweep_hits(task, low, up, carrier="stage", exempt=pair) == ()


def test_a_deviation_stands_for_the_moving_spread(task: Task) -> None:
    state = jaws_over_gear(task, 30.0)
    after = replace(state, stage=Axis4(x_um=-600, y_um=10.0))

    def hits(x_um: float) -> tuple[Hit, ...]:
        box = (-x_um, 0.0, x_um, 0.0)
        return sweep_hits(task, state, after, carrier="stage", deviation=box)

    room_um = 130.0 / 2 - GEAR_UM - 2 * ROBOT_UM
    assert hits(room_um - 0.1) == ()
    assert {h.moving for h in hits(room_um + 0.1)} == {"gear"}


def test_a_turn_is_swept_and_not_only_its_ends(task: Task) -> None:
    start = initial(task)
    aside = replace(
        start,
        stage=Axis4(),
        robot=Axis4(x_um=1500, z_um=60, theta_rad=-math.pi / 2),
        opening_um=130.0,
    )
    turned = replace(aside, robot=replace(aside.robot, theta_rad=math.pi / 2))
    assert not sweep_hits(task, aside, aside, carrier="robot")
    hits = sweep_hits(task, aside, turned, carrier="robot")
    assert "shaft_plate.post" in {hit.still for hit in hits}
