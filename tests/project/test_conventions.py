"""What docs/conventions.md says, where several packages have to agree on it."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import microplan.executor.motion.beliefs
import microplan.planner.assembly.assembly
from microplan.executor.devices.drivers import AxisReading
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.featuresel.features.factorial_design import words
from microplan.featuresel.routines.picture import RegionFrame
from microplan.optics.lens.jacobian import to_px
from microplan.optics.render.render import render
from microplan.planner.assembly.assembly import Axis4
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.world import build_world
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.read_workcell import COVERAGE
from microplan.planner.task.task import Task
from microplan.schemas.codec import quantise, to_data
from microplan.schemas.pose import Pose
from tests.optics.shapes import disc, microscope, one_layer

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_on_shaft" / "task.yaml"
LENGTHS = st.floats(-5000, 5000)
ANGLES = st.floats(-math.pi, math.pi)


@pytest.fixture(scope="module")
def task() -> Task:
    """Return the example's task."""
    found = load_task(EXAMPLE, Report())
    assert found is not None
    return found


@pytest.fixture(scope="module")
def cell(task: Task) -> Cell:
    """Return a simulated cell of the example whose axes can be set to be exact."""
    cell = build_cell(build_world(task, initial(task)), seed=1)
    cell.truth.tilt = (0.0, 0.0)
    cell.truth.drift_um_per_s = (0.0, 0.0)
    for group in (cell.truth.stage, cell.truth.robot):
        group.error = dict.fromkeys(group.error, 0.0)
    return cell


def _same(one: Pose, other: Pose) -> bool:
    # lengths up to 1e4 um, summed: a few units in the 16th digit
    pairs = (
        (one.x_um, other.x_um),
        (one.y_um, other.y_um),
        (one.theta_rad, other.theta_rad),
    )
    return all(math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-9) for a, b in pairs)


@settings(max_examples=50, deadline=None)
@given(x=LENGTHS, y=LENGTHS, theta=ANGLES)
def test_all_three_agree_on_where_stage_and_grip_are(
    task: Task, cell: Cell, x: float, y: float, theta: float
) -> None:
    axis = Axis4(x_um=x, y_um=y, theta_rad=theta)
    reading = AxisReading(x_um=x, y_um=y, z_um=0.0, theta_rad=theta)
    now = {"x_um": x, "y_um": y, "z_um": 0.0, "theta_rad": theta}
    cell.truth.stage.actual = now
    cell.truth.robot.actual = now
    center = task.workcell.stage.theta_axis_um
    compiled = microplan.planner.assembly.assembly.stage_pose(task, axis)
    assert _same(
        compiled, microplan.executor.motion.beliefs.stage_pose(reading, center)
    )
    assert _same(compiled, cell.truth.stage_pose())
    grip = microplan.planner.assembly.assembly.robot_pose(axis)
    assert _same(grip, microplan.executor.motion.beliefs.grip_pose(reading))
    assert _same(grip, cell.truth.grip_pose())


@given(x=LENGTHS, y=LENGTHS, a=LENGTHS, b=LENGTHS, theta=ANGLES)
def test_the_axis_travels_with_the_stage(
    x: float, y: float, a: float, b: float, theta: float
) -> None:
    reading = AxisReading(x_um=x, y_um=y, z_um=0.0, theta_rad=theta)
    found = microplan.executor.motion.beliefs.stage_pose(reading, (a, b)).apply(a, b)
    assert found == pytest.approx((x + a, y + b), abs=1e-9)


@given(x=LENGTHS, y=LENGTHS, row=st.integers(0, 400), column=st.integers(0, 500))
def test_pixels_of_the_frame_and_of_a_region(
    x: float, y: float, row: int, column: int
) -> None:
    optics = microscope(6.9, 640, 480)
    k = 6.9 / 7.5
    expected = (319.5 + k * x, 239.5 - k * y)
    assert to_px(np.array([x, y]), optics) == pytest.approx(expected, abs=1e-8)
    region = RegionFrame(
        width_px=640, height_px=480, um_per_px=1 / k, row=row, column=column
    )
    inside = region.to_pixel(x, y)
    assert inside == pytest.approx((expected[0] - column, expected[1] - row), abs=1e-8)
    assert region.to_world(*inside) == pytest.approx((x, y), abs=1e-8)


def test_images_have_x_right_and_y_up() -> None:
    optics = microscope(6.9, 160, 120)
    image = render(one_layer(disc(5.0, (20.0, 15.0))), optics, focus_um=0.0)
    column, row = to_px(np.array([20.0, 15.0]), optics)
    assert image[round(row), round(column)] > 0.9
    assert image[round(119 - row), round(column)] < 0.1


def test_poses_turn_first_and_then_shift() -> None:
    pose = Pose(x_um=10.0, y_um=0.0, theta_rad=math.pi / 2)
    assert pose.apply(1.0, 0.0) == pytest.approx((10.0, 1.0))
    inner = Pose(x_um=1.0, y_um=2.0, theta_rad=0.3)
    assert pose.compose(inner).apply(3.0, 4.0) == pytest.approx(
        pose.apply(*inner.apply(3.0, 4.0))
    )


def test_coverage_divides_to_one_sigma() -> None:
    assert pytest.approx({"1sigma": 1, "3sigma": 3, "range": 3**0.5}) == COVERAGE
    # a uniform spread of half-width 1, by summing over it
    x = np.linspace(-1, 1, 200_001)
    assert x.std() == pytest.approx(1 / COVERAGE["range"], rel=1e-4)


def test_seed_words_are_the_sha256_of_the_key() -> None:
    digest = hashlib.sha256(b"gear/look 1").hexdigest()
    assert "".join(f"{word:08x}" for word in words("gear/look 1")) == digest


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1 / 3, "0.333333"), (123456.7, "123457.0"), (-1e-320 * 0.0, "0.0"),
        (2.5, "2.5"), (1.0000001e-9, "1e-09"),
    ],
)  # fmt: skip
def test_plans_hold_six_digits(value: float, text: str) -> None:
    assert json.dumps(to_data(value)) == text
    assert quantise(quantise(value)) == quantise(value)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_plans_hold_finite_numbers(value: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        to_data(value)
