"""Targets: what of them must be in the field."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from microplan.planner.assembly.assembly import Axis4, bodies
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.shapes import polygon
from microplan.planner.task.task import Task
from microplan.planner.views.targets import JAWS_SEEN_UM, shape_of
from tests.planner.examples import EXAMPLE, change, copy_example, read


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.mark.parametrize("quarters", [-1, 0, 1, 2])
def test_the_jaws_box_is_where_the_fingers_are(task: Task, quarters: int) -> None:
    """At quarter turns the box is the fingers' own bounds, cut off behind the grip."""
    turn_rad = quarters * math.pi / 2
    state = replace(initial(task), robot=Axis4(theta_rad=turn_rad))
    shape = shape_of(task, state, "tweezers")
    assert shape is not None
    # the fingers reach 20 mm towards +y of the tool: the side that a look cuts off
    kept = {
        0: (-1e4, -1e4, 1e4, JAWS_SEEN_UM),
        1: (-JAWS_SEEN_UM, -1e4, 1e4, 1e4),
        2: (-1e4, -JAWS_SEEN_UM, 1e4, 1e4),
        -1: (-1e4, -1e4, JAWS_SEEN_UM, 1e4),
    }
    fingers = [polygon(b.outline) for b in bodies(task, state) if b.carrier == "robot"]
    seen = shapely.clip_by_rect(shapely.union_all(fingers), *kept[quarters])
    # the drawn fingers widen by 60 um over their 20.8 mm: 0.35 um over what is seen
    assert shape.box_um == pytest.approx(seen.bounds, abs=0.35)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0])
def test_a_whole_outline_has_the_room_of_its_angles(
    tmp_path: Path, degrees: float
) -> None:
    """The plate is a square: turned by 30 degrees it is 1.366 as wide."""
    file = copy_example(tmp_path / "task")
    old = "shaft_plate: {on: stage, x_um: 0,   y_um: 0, theta_deg: "
    change(file, f"{old}0", f"{old}{degrees}")
    task = read(file)
    state = initial(task)
    shape = shape_of(task, state, "shaft_plate")
    assert shape is not None
    sigma = state.parts["shaft_plate"].sigma_theta_rad
    assert 0 < sigma < 0.05
    spread = max(sigma, task.benchmark.pose_sigma_theta_rad)
    turns = np.radians(degrees) + np.linspace(-3, 3, 1001) * spread
    half_um = 350 * (np.abs(np.cos(turns)) + np.abs(np.sin(turns))).max()
    assert shape.box_um[0] == shape.box_um[1] == -shape.box_um[2] == -shape.box_um[3]
    beyond_um = 350 * math.sqrt(2) * (1 - math.cos(1.5 * spread))
    assert half_um - 1e-9 <= shape.box_um[2] <= half_um + beyond_um + 1e-9
    for loose in (math.pi, 0.3):
        plate = replace(state.parts["shaft_plate"], sigma_theta_rad=loose)
        parts = {**state.parts, "shaft_plate": plate}
        any_way = shape_of(task, replace(state, parts=parts), "shaft_plate")
        assert any_way is not None
        assert any_way.box_um[2] == pytest.approx(350 * math.sqrt(2))
