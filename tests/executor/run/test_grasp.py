"""Beliefs after a grasp are where the simulated jaws truly turn the part."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from microplan.executor.run.artifacts import Artifacts
from microplan.optics.outline.outline import Outline, Ring, Segment, place
from microplan.planner.assembly.holding import rests_of
from microplan.schemas.files.world import World
from microplan.schemas.plan import (
    AlignAction,
    AxisMove,
    GraspAction,
    MoveAction,
    Plan,
    RestAngle,
)
from tests.executor.bench import (
    control,
    plan_of,
    quiet,
    stage_to,
    step,
    world,
    world_outline,
)
from tests.executor.disc import look
from tests.executor.recorder import Run, run

PLACES = 1e-6  # rest angles are rounded, um and rad
ARM_UM = 60.0  # from any origin here to the jaws


def polygon(*corners: tuple[float, float]) -> Outline:
    ends = (*corners[1:], corners[0])
    edges = tuple(Segment(start=a, end=b) for a, b in zip(corners, ends, strict=True))
    return Outline(rings=(Ring(edges=edges),))


def hexagon(flats_um: float) -> Outline:
    """Return a hexagon, flat against the jaws at 30 degrees."""
    radius = flats_um / math.sqrt(3)
    turns = [math.radians(60 * k) for k in range(6)]
    return polygon(*((radius * math.cos(t), radius * math.sin(t)) for t in turns))


BOX = place(polygon((-49, -55), (49, -55), (49, 55), (-49, 55)), 6.0, -4.0)
HEXAGON = hexagon(99.0)


def cell(outline: Outline, start_deg: float) -> World:
    """Return a quiet world whose gear is another part, at an angle."""
    found = quiet(world())
    gear, plate = found.parts
    part = replace(
        gear,
        outline=world_outline(outline),
        holes=(),
        start=replace(gear.start, theta_rad=math.radians(start_deg)),
    )
    return replace(found, parts=(part, plate))


def plan(
    rests: tuple[RestAngle, ...], measured_deg: float, sigma_deg: float, *, needed: bool
) -> Plan:
    """Return a plan that grasps a part whose angle is known so well."""
    approach = (
        stage_to(y_um=-180.0),
        AxisMove(axes="robot", x_um=0.0, y_um=0.0),
        AxisMove(axes="robot", z_um=30.0),
        stage_to(y_um=0.0),
    )
    close = GraspAction(
        target="gear", tool="tweezers", opening_um=96.0, across_um=1.5, rests=rests
    )
    turn = AlignAction(
        target="gear", to="shaft_plate", look="disc", axes="robot", path=("xy",)
    )
    steps = [step("between", MoveAction(), moves=approach), step("grasp", close)]
    if needed:
        servo = replace(control(tolerance_xy_um=3.0), tolerance_theta_rad=0.01)
        steps.append(step("turn", turn, looks=(look()[0],), servo=servo))
    made = plan_of(steps)
    gear, plate, tool = made.beliefs
    theta_rad, sigma_rad = math.radians(measured_deg), math.radians(sigma_deg)
    gear = replace(
        gear,
        pose=replace(gear.pose, theta_rad=theta_rad),
        sigma_theta_rad=sigma_rad,
    )
    tool = replace(tool, sigma_theta_rad=0.0)
    return replace(made, beliefs=(gear, plate, tool))


def go(
    outline: Outline, start_deg: float, *, sigma_deg: float = 0.1, needed: bool = False
) -> Run:
    """Run a grasp of a part whose angle was measured truly."""
    made = plan(rests_of(outline), start_deg, sigma_deg, needed=needed)
    return run(made, Artifacts({}), cell(outline, start_deg))


@pytest.mark.parametrize(
    ("outline", "start_deg"),
    [
        (BOX, 5.0), (BOX, 95.0), (BOX, 184.0), (BOX, -87.0),
        (HEXAGON, 25.0), (HEXAGON, 85.0), (HEXAGON, -143.0),
    ],
)  # fmt: skip
def test_a_part_is_believed_where_the_jaws_turn_it(
    outline: Outline, start_deg: float
) -> None:
    found = go(outline, start_deg)
    body = found.cell.truth.bodies["gear"]
    assert found.cell.truth.held == "gear"
    turned_rad = body.pose.theta_rad - math.radians(start_deg)
    assert 2 < abs(math.degrees(math.remainder(turned_rad, math.tau))) < 8
    belief = found.beliefs.belief("gear")
    off_rad = math.remainder(belief.pose.theta_rad - body.pose.theta_rad, math.tau)
    assert off_rad == pytest.approx(0.0, abs=PLACES)
    apart_um = math.dist(
        (belief.pose.x_um, belief.pose.y_um), (body.pose.x_um, body.pose.y_um)
    )
    assert apart_um < ARM_UM * PLACES + PLACES


def test_without_rest_angles_the_angle_is_kept() -> None:
    """So older plans run as they did."""
    made = plan((), 5.0, 0.1, needed=False)
    belief = run(made, Artifacts({}), cell(BOX, 5.0)).beliefs.belief("gear")
    assert belief.pose.theta_rad == pytest.approx(math.radians(5.0))
    assert belief.pose.x_um == pytest.approx(1.5)


def test_of_an_unknown_angle_nothing_follows() -> None:
    made = plan(rests_of(BOX), 5.0, 180.0, needed=False)
    belief = run(made, Artifacts({}), cell(BOX, 5.0)).beliefs.belief("gear")
    assert belief.pose.theta_rad == pytest.approx(math.radians(5.0))
    assert belief.pose.x_um == pytest.approx(1.5)
    assert belief.sigma_theta_rad == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("start_deg", "sigma_deg", "needed", "stopped"),
    [
        (1.0, 1.0, True, True),  # 1 degree from the middle between -30 and 30 degrees
        (1.0, 1.0, False, False),
        (1.0, 0.1, True, False),
        (27.0, 1.0, True, False),
    ],
)
def test_jaws_that_may_turn_a_part_either_way_stay_open_if_its_angle_is_needed(
    start_deg: float, sigma_deg: float, needed: bool, stopped: bool
) -> None:
    found = go(HEXAGON, start_deg, sigma_deg=sigma_deg, needed=needed)
    assert (found.result.code == "MP824") == stopped
    closed = [c for c in found.recorder.calls if c.device == "jaws"]
    assert any(c.method == "start" for c in closed) != stopped
    assert (found.cell.truth.held == "gear") != stopped
    if stopped:
        assert "turn gear to 30 deg in tweezers" in found.result.message
        assert "turn needs its angle" in found.result.message


def test_a_part_that_may_lie_either_way_is_believed_as_badly_known() -> None:
    """60 degrees apart, the other with a probability of 16 %."""
    belief = go(HEXAGON, 1.0, sigma_deg=1.0).beliefs.belief("gear")
    wanted_rad = math.radians(60) * math.sqrt(math.erfc(1 / math.sqrt(2)) / 2)
    assert belief.sigma_theta_rad == pytest.approx(wanted_rad, rel=1e-4)
