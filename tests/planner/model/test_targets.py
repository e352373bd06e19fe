"""Targets: what of them must be in the field."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import shapely

from planner.inputs.task import Task
from planner.model.assembly import Axis4, bodies, initial
from planner.model.shapes import polygon
from planner.model.targets import JAWS_SEEN_UM, shape_of
from tests.planner.examples import EXAMPLE, read


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
