"""Where jaws stand that close on a part: at its outline, wherever they are sent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from microplan.executor.simulated.cameras.solid_pictures import bodies_of
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.gripper import close_jaws, open_jaws, stopped_um
from microplan.executor.simulated.shapes import polygons
from microplan.schemas.pose import Pose
from tests.executor.bench import quiet, world

SAGITTA_UM = 0.05  # arcs as chords


def around(theta_rad: float, off_um: float = 0.0) -> Cell:
    """Return a cell whose open jaws are about the gear."""
    found = build_cell(quiet(world()), 1)
    body = found.truth.bodies["gear"]
    body.pose = Pose(x_um=600.0 + off_um, y_um=0.0, theta_rad=theta_rad)
    found.robot.move(x_um=0.0, y_um=0.0, z_um=30.0)
    return found


def gap_um(found: Cell) -> tuple[float, float]:
    """Return the area, um2, that fingers share with the gear, and how near they are."""
    truth = found.truth
    body, tool = truth.bodies["gear"], truth.tool
    assert tool is not None
    gear = shapely.Polygon(turned(body.rings[0], truth.pose(body)))
    fingers = shapely.union_all([
        shapely.Polygon(
            turned(polygons(finger)[0] + (side * truth.opening_um / 2, 0.0),
                   truth.grip_pose())
        )
        for side, finger in ((-1, tool.left), (1, tool.right))
    ])  # fmt: skip
    return gear.intersection(fingers).area, gear.distance(fingers)


def turned(points: np.ndarray, pose: Pose) -> np.ndarray:
    """Return (N, 2) um points of a frame in the world."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    moved: np.ndarray = points @ np.array([[c, s], [-s, c]]) + (pose.x_um, pose.y_um)
    return moved


@pytest.mark.parametrize("theta_deg", [0.0, 7.0, 33.0])
@pytest.mark.parametrize("off_um", [0.0, 9.0])
def test_jaws_stop_at_the_part_that_they_grasp(theta_deg: float, off_um: float) -> None:
    found = around(math.radians(theta_deg), off_um)
    close_jaws(found.truth, 96.0)
    assert found.truth.held == "gear"
    width_um = 100 * math.cos(math.radians(6))  # on two neighbouring tips either side
    assert found.truth.opening_um == pytest.approx(width_um, abs=SAGITTA_UM)
    area_um2, apart_um = gap_um(found)
    assert area_um2 < SAGITTA_UM  # at lines of tips without width
    assert apart_um < SAGITTA_UM


def test_jaws_of_a_wider_part_stop_earlier() -> None:
    found = around(0.0)
    body = found.truth.bodies["gear"]
    body.edge, body.rings = body.edge * 1.02, tuple(r * 1.02 for r in body.rings)
    close_jaws(found.truth, 96.0)
    width_um = 102 * math.cos(math.radians(6))
    assert found.truth.opening_um == pytest.approx(width_um, abs=SAGITTA_UM)


def test_jaws_that_hold_a_part_close_no_further() -> None:
    found = around(0.0)
    close_jaws(found.truth, 96.0)
    stopped = found.truth.opening_um
    close_jaws(found.truth, 90.0)
    assert found.truth.opening_um == pytest.approx(stopped, abs=1e-9)
    open_jaws(found.truth, 98.0)  # not yet as wide as the part
    assert found.truth.opening_um == pytest.approx(stopped, abs=1e-9)
    assert found.truth.held == "gear"


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_part_that_sticks_comes_back_with_its_finger(side: float) -> None:
    found = around(0.0)
    close_jaws(found.truth, 96.0)
    open_jaws(found.truth, 130.0, stick_side=side)
    off_um = side * (130 - 100 * math.cos(math.radians(6))) / 2
    body = found.truth.bodies["gear"]
    assert body.pose.x_um == pytest.approx(off_um, abs=SAGITTA_UM)
    assert gap_um(found)[1] < SAGITTA_UM
    close_jaws(found.truth, 96.0)
    assert body.pose.x_um == pytest.approx(0.0, abs=1e-6)
    assert gap_um(found)[0] < SAGITTA_UM


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_part_that_sticks_stops_jaws_that_were_at_their_widest(side: float) -> None:
    """Its far end is at the finger, wherever doubles round to."""
    found = around(0.0)
    truth = found.truth
    assert truth.tool is not None
    close_jaws(truth, 96.0)
    stopped = truth.opening_um
    open_jaws(truth, truth.tool.opening_um[1], stick_side=side)
    body = truth.bodies["gear"]
    body.pose = replace(body.pose, x_um=body.pose.x_um + side * 1e-12)
    close_jaws(truth, 96.0)
    assert truth.opening_um == pytest.approx(stopped, abs=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_part_that_sticks_stays_at_its_finger_as_jaws_open_on(side: float) -> None:
    found = around(0.0)
    close_jaws(found.truth, 96.0)
    for opening_um, other in ((120.0, side), (130.0, -side)):
        open_jaws(found.truth, opening_um, stick_side=other)
        assert gap_um(found)[0] < SAGITTA_UM
        assert gap_um(found)[1] < SAGITTA_UM
        assert found.truth.stuck
    assert math.copysign(1.0, found.truth.bodies["gear"].pose.x_um) == side
    close_jaws(found.truth, 110.0)
    assert found.truth.stuck
    close_jaws(found.truth, 96.0)
    assert not found.truth.stuck  # both fingers hold it


def test_what_stands_wide_of_the_jaws_stops_none() -> None:
    found = around(0.0)
    assert stopped_um(found.truth, 130.0) == 130.0
    found.robot.move(y_um=3000.0)
    assert stopped_um(found.truth, 96.0) == 96.0
    empty = replace(world(), tools=())
    assert stopped_um(build_cell(quiet(empty), 1).truth, 96.0) == 96.0


def test_a_picture_shows_fingers_where_they_stop() -> None:
    found = around(0.0)
    found.jaws.move(96.0)
    fingers = [b for b in bodies_of(found.truth).bodies if b.name.startswith("tweez")]
    apart_um = math.dist(*((b.pose.x_um, b.pose.y_um) for b in fingers))
    assert apart_um == pytest.approx(100 * math.cos(math.radians(6)), abs=SAGITTA_UM)
