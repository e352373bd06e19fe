"""The prisms that stand for parts and fingers hold them, and have few corners."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.planner.assembly.shapes import polygon
from microplan.planner.assembly.world import few_corners, finger_solids, part_solids
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.schemas.plan.views import MOST_CORNERS, Prism
from tests.planner.examples import EXAMPLE


@pytest.fixture(scope="module")
def task() -> Task:
    report = Report()
    found = load_task(EXAMPLE / "task.yaml", report)
    assert found is not None, report.found
    return found


def holds(prism: Prism, outline: shapely.Geometry) -> bool:
    return bool(shapely.Polygon(prism.corners_um).contains(outline))


def test_a_part_lies_in_its_prisms(task: Task) -> None:
    solids = {solid.name: solid.prisms for solid in part_solids(task)}
    assert sorted(solids) == sorted(task.parts)
    gear, (plate, post) = solids["gear"][0], solids["shaft_plate"]
    assert holds(gear, polygon(task.parts["gear"].outline))
    assert (gear.low_um, gear.high_um) == (0.0, 100.0)
    shaft = task.parts["shaft_plate"]
    assert holds(plate, polygon(shaft.outline))
    assert holds(post, polygon(shaft.posts["post"].outline))
    assert (post.low_um, post.high_um) == (0.0, 250.0)  # on a plate without thickness


def test_fingers_lie_in_their_prisms(task: Task) -> None:
    (fingers,) = finger_solids(task)
    tool = task.workcell.tools[fingers.tool]
    assert holds(fingers.left, polygon(tool.left))
    assert holds(fingers.right, polygon(tool.right))
    assert fingers.left.high_um == tool.thickness_um


def test_prisms_are_convex_run_counter_clockwise_and_have_few_corners(
    task: Task,
) -> None:
    prisms = [prism for solid in part_solids(task) for prism in solid.prisms]
    prisms += [f for each in finger_solids(task) for f in (each.left, each.right)]
    for prism in prisms:
        shape = shapely.Polygon(prism.corners_um)
        assert len(prism.corners_um) <= MOST_CORNERS
        assert shape.exterior.is_ccw
        assert shape.convex_hull.area == pytest.approx(shape.area, rel=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 60))
def test_fewer_corners_hold_the_polygon(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 2)) * (1.0, 30.0)
    convex = shapely.MultiPoint(points).convex_hull
    corners = shapely.get_coordinates(convex.normalize())[:-1][::-1]
    for most in (4, 16):
        fewer = few_corners(corners, most)
        assert len(fewer) <= most
        assert shapely.Polygon(fewer).buffer(1e-9).contains(convex)


def test_a_circle_grows_by_little() -> None:
    turns = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    circle = np.stack((np.cos(turns), np.sin(turns)), axis=1)
    area = shapely.Polygon(few_corners(circle)).area
    # the least that 16 tangents enclose is 16 tan(pi / 16), 1.3 % more than the
    # circle; edges that go one after the other end within three times that
    assert 16 * np.tan(np.pi / 16) - 1e-3 <= area < np.pi * 1.039


def test_a_corner_less_than_four_is_refused() -> None:
    with pytest.raises(ValueError, match="4 corners"):
        few_corners(np.zeros((5, 2)), 3)
