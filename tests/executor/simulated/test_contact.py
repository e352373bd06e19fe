"""The contact rules of the simulated cell against cases worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.outlines.fabricated import fabricated_ring
from microplan.executor.simulated.outlines.flattening import SAGITTA_UM
from microplan.executor.simulated.outlines.pushing import FREE_UM
from microplan.executor.simulated.truth import TrueBody
from microplan.schemas.pose import Pose
from tests.executor.bench import quiet, world

CLEARANCE_UM = 3.0  # bore radius 25 with a notch, post radius 22
SAFE_UM = 2 * SAGITTA_UM + 2 * FREE_UM  # a pushed part is as much nearer at most


def cell(*faults: str) -> Cell:
    """Return a cell without any spread: everything is where it should be."""
    return build_cell(quiet(world()), 1, frozenset(faults))


def gear(found: Cell) -> TrueBody:
    return found.truth.bodies["gear"]


def hold(found: Cell, *, off_um: tuple[float, float] = (0.0, 0.0)) -> None:
    """Bring the gear between the jaws, grasp it and lift it off the stage."""
    stage, robot, jaws = found.stage, found.robot, found.jaws
    gear(found).pose = Pose(x_um=600.0, y_um=0.0)
    stage.move(y_um=-180.0)
    robot.move(x_um=0.0, y_um=0.0)
    robot.move(z_um=30.0)
    stage.move(y_um=0.0)
    jaws.move(96.0)
    stage.move(z_um=-260.0)
    stage.move(x_um=off_um[0], y_um=off_um[1])


def drop(found: Cell) -> None:
    """Insert, release and take the tool away."""
    robot, jaws = found.robot, found.jaws
    found.stage.move(z_um=0.0)
    jaws.move(130.0)
    robot.move(z_um=400.0)
    robot.move(y_um=3000.0)


def test_a_nominal_assembly_seats_the_gear() -> None:
    found = cell()
    hold(found)
    assert found.truth.held == "gear"
    drop(found)
    verdict = found.judge("gear", "shaft_plate.post")
    assert verdict.success, verdict
    assert verdict.offset_um == pytest.approx(0.0, abs=1e-6)
    assert verdict.height_um == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("minutes", [0.1, 1.0, 10.0])
def test_a_post_pushes_as_the_stage_drifts_under_a_held_part(minutes: float) -> None:
    """In 2.95 um off of 3; the drift would carry the post through the bore's wall."""
    found = cell()
    hold(found, off_um=(-2.95, 0.0))  # the stage: the gear is off the other way
    found.stage.move(z_um=0.0)
    found.truth.drift_um_per_s = (-0.1 / 60, 0.0)
    found.clock.wait(60 * minutes)
    found.jaws.move(130.0)
    drifted_um = 0.1 / 60 * found.clock.now_s()  # all of it since the cell was built
    drop(found)
    verdict = found.judge("gear", "shaft_plate.post")
    assert verdict.success, verdict
    expected = min(2.95 + drifted_um, CLEARANCE_UM)
    assert expected - SAFE_UM <= verdict.offset_um <= expected + 1e-6
    assert verdict.offset_um <= CLEARANCE_UM + 1e-6


def test_a_part_beside_a_mark_is_judged_by_its_own_place() -> None:
    """The seat is a hole of another part; here the post's place beside the bore."""
    found = cell()
    gear(found).pose = Pose(x_um=600.0, y_um=0.0, theta_rad=0.3)
    plate = found.truth.bodies["shaft_plate"]
    plate.pose = Pose(x_um=597.0, y_um=4.0)
    plate.z_um = 100.0  # on the gear's face
    far = found.judge("shaft_plate", "gear.bore", 4.9)
    near = found.judge("shaft_plate", "gear.bore", 5.1)
    assert far.offset_um == near.offset_um == pytest.approx(5.0)
    assert near.height_um == pytest.approx(0.0, abs=1e-9)
    assert near.success
    assert not far.success
    assert near.turn_rad == pytest.approx(-0.3)  # the gear lies turned
    assert found.judge("shaft_plate", "gear.bore", 5.1, 0.31).success
    assert not found.judge("shaft_plate", "gear.bore", 5.1, 0.29).success
    plate.z_um = 110.0
    assert not found.judge("shaft_plate", "gear.bore", 5.1).success
    with pytest.raises(ValueError, match="no post and no hole"):
        found.judge("shaft_plate", "gear.teeth", 5.1)


def test_a_grasped_part_is_centred_and_turned_to_a_minimum_of_its_width() -> None:
    found = cell()
    hold(found)
    body = gear(found)
    assert body.pose.x_um == pytest.approx(0.0, abs=1e-6)
    # flat on two neighbouring tips: every 20 degrees, half a pitch off
    off_rad = math.remainder(body.pose.theta_rad - math.radians(10), math.radians(20))
    assert off_rad == pytest.approx(0.0, abs=1e-6)
    assert found.truth.opening_um > 96.0  # the jaws stop at the gear


def test_a_held_part_keeps_its_height_to_the_tool() -> None:
    found = cell()
    hold(found)
    assert gear(found).z_um == pytest.approx(-30.0)
    assert found.truth.under_um(gear(found)) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("x_um", "y_um", "holds"),
    [
        (600.0, 0.0, True),
        (600.0, 300.0, True),
        (600.0, -80.0, False),
        (900.0, 0, False),
    ],
    ids=["at the grip", "far behind", "before the tips", "beside"],
)
def test_jaws_hold_only_what_is_between_them(
    x_um: float,
    y_um: float,
    holds: bool,
) -> None:
    found = cell()
    jaws, robot = found.jaws, found.robot
    robot.move(x_um=0.0, y_um=0.0, z_um=30.0)
    gear(found).pose = Pose(x_um=x_um, y_um=y_um)
    jaws.move(96.0)
    assert (found.truth.held == "gear") == holds


def test_jaws_that_stay_wider_than_the_part_hold_nothing() -> None:
    found = cell()
    jaws, robot = found.jaws, found.robot
    robot.move(x_um=0.0, y_um=0.0, z_um=30.0)
    jaws.move(110.0)
    assert found.truth.held == ""
    assert gear(found).carrier == "stage"


def test_jaws_above_the_part_hold_nothing() -> None:
    found = cell()
    jaws, robot = found.jaws, found.robot
    robot.move(x_um=0.0, y_um=0.0, z_um=101.0)
    jaws.move(96.0)
    assert found.truth.held == ""


@pytest.mark.parametrize("off_um", [2.9, 3.1])
@pytest.mark.parametrize("angle_rad", [0.0, 1.0, 2.5])
def test_the_part_goes_in_below_the_capture_radius_only(
    off_um: float, angle_rad: float
) -> None:
    found = cell()
    hold(found, off_um=(off_um * math.cos(angle_rad), off_um * math.sin(angle_rad)))
    drop(found)
    verdict = found.judge("gear", "shaft_plate.post")
    assert verdict.success == (off_um < CLEARANCE_UM), verdict
    if off_um > CLEARANCE_UM:  # it lies on top of the post, 250 um up
        assert verdict.height_um == pytest.approx(250.0)
    assert verdict.offset_um == pytest.approx(off_um, abs=1e-6)
    assert verdict.collided == ""


def test_tilt_counts_at_the_height_where_the_post_meets_the_part() -> None:
    # aligned at z = -260; going up by 10 um to the meeting height moves the post by
    # 10 tilt = .2 um: enough to take 2.9 um to 3.1 um, and not enough for 2.7 um
    for off_um, seats in ((2.9, False), (2.7, True)):
        found = cell()
        hold(found)
        found.truth.tilt = (0.02, 0.0)
        tilted_um = -260.0 * 0.02
        found.stage.move(x_um=off_um - tilted_um, y_um=0.0)
        drop(found)
        verdict = found.judge("gear", "shaft_plate.post")
        assert (verdict.height_um < 1.0) == seats, (off_um, verdict)


def test_profile_offsets_change_the_capture_radius() -> None:
    found = cell()
    bore = gear(found).holes[0]
    edges = gear(found).part.outline.rings[1].edges
    smaller = fabricated_ring(edges, -1.0, post=False)
    assert smaller is not None
    gear(found).holes = (replace(bore, ring=smaller),)
    gear(found).rings = (gear(found).rings[0], smaller.corners_um)
    hold(found, off_um=(2.5, 0.0))
    drop(found)
    assert found.judge("gear", "shaft_plate.post").height_um == pytest.approx(250.0)


def test_a_blocked_part_lies_on_top_of_the_post() -> None:
    found = cell("block")
    hold(found)
    assert list(found.faults.idle) == ["block"]
    drop(found)
    assert list(found.faults.idle) == []
    verdict = found.judge("gear", "shaft_plate.post")
    assert not verdict.success
    assert not verdict.held
    assert verdict.height_um == pytest.approx(250.0)


def test_a_part_that_sticks_follows_the_finger_and_is_held() -> None:
    found = cell("stick")
    found.jaws.move(120.0)
    found.jaws.move(130.0)  # they let go of nothing
    assert list(found.faults.idle) == ["stick"]
    hold(found)
    found.stage.move(z_um=0.0)
    jaws, robot = found.jaws, found.robot
    jaws.move(130.0)
    assert list(found.faults.idle) == []
    # it was pulled aside until the post stopped it
    pulled_um = found.judge("gear", "shaft_plate.post").offset_um
    assert CLEARANCE_UM - SAFE_UM <= pulled_um <= CLEARANCE_UM
    robot.move(z_um=400.0)
    verdict = found.judge("gear", "shaft_plate.post")
    assert verdict.held
    assert not verdict.success
    assert verdict.height_um == pytest.approx(370.0)


def test_a_part_released_in_the_air_falls() -> None:
    found = cell()
    hold(found, off_um=(-300.0, 0.0))
    jaws = found.jaws
    jaws.move(130.0)
    assert found.truth.under_um(gear(found)) == pytest.approx(-260.0)
    assert gear(found).carrier == "stage"


def test_fingers_that_meet_a_part_collide() -> None:
    found = cell()
    robot = found.robot
    robot.move(x_um=0.0, y_um=600.0, z_um=30.0)
    assert found.truth.collided == ""
    robot.move(x_um=80.0)
    robot.move(y_um=0.0)
    assert found.truth.collided == "tweezers hit gear"


def test_fingers_that_go_below_the_stage_collide() -> None:
    found = cell()
    found.stage.move(z_um=450.0)
    assert "tweezers hit the stage" in found.truth.collided


def test_a_post_that_runs_into_a_held_part_from_the_side_collides() -> None:
    found = cell()
    hold(found, off_um=(0.0, -200.0))  # in front of the tips
    found.stage.move(z_um=-200.0)
    found.stage.move(y_um=0.0)
    assert "ran into the side of gear" in found.truth.collided


def test_limits_are_kept() -> None:
    found = cell()
    with pytest.raises(ValueError, match=r"stage.x_um = 6000 is outside"):
        found.stage.move(x_um=6000.0)
    assert found.stage.reading().x_um == -600.0


def test_a_missing_part_is_missing() -> None:
    assert "gear" not in cell("no_part").truth.bodies


def test_an_axis_error_is_redrawn_only_for_the_axes_that_move() -> None:
    found = build_cell(world(), 5)
    stage = found.truth.stage
    before = dict(stage.error)
    found.stage.move(x_um=0.0, y_um=1.0)
    assert stage.error["x_um"] != before["x_um"]
    assert stage.error["y_um"] != before["y_um"]
    assert stage.error["z_um"] == before["z_um"]
    assert stage.actual["x_um"] == pytest.approx(stage.error["x_um"])
    assert found.stage.reading().x_um == 0.0


def test_an_angle_error_of_the_robot_swings_the_grip_by_its_lever() -> None:
    found = build_cell(quiet(world()), 5)
    spec = found.truth.robot.spec
    found.truth.robot.spec = replace(spec, repeatability_theta_rad=1e-4)
    robot = found.robot
    robot.move(theta_rad=0.1)
    error_rad = found.truth.robot.error["theta_rad"]
    lever_um = 20800.0 - 60.0
    grip = found.truth.grip_pose()
    # the grip moves along the jaws' x axis, to first order in the error
    along = (grip.x_um - 0.0) * math.cos(0.1) + (grip.y_um - 3000.0) * math.sin(0.1)
    assert along == pytest.approx(lever_um * error_rad, rel=1e-6)
