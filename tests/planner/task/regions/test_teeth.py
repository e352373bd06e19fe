"""Toothed rings of straight edges against the same rings of arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, Ring, flatten, place
from microplan.planner.drawings.rings import canonical
from microplan.planner.task.regions.features import NotFoundError, teeth
from microplan.planner.task.regions.symmetry import symmetry_order
from microplan.planner.task.regions.teeth import teeth_of
from tests.planner.chips import cross, rectangle, slot
from tests.planner.task.regions.test_features import gear
from tests.planner.task.regions.test_symmetry import circle, polygon


@settings(max_examples=25, deadline=None)
@given(
    count=st.integers(9, 60),  # fewer shallow ones make a convex polygon
    phase=st.floats(-7, 7),
    tip=st.floats(0.1, 0.45),
    depth=st.floats(0.05, 0.4),
    chord_um=st.floats(1e-3, 0.05),
    x=st.floats(-500, 500),
)
def test_a_gear_of_chords_is_the_gear_of_arcs(
    count: int, phase: float, tip: float, depth: float, chord_um: float, x: float
) -> None:
    """Flanks are the same lines, and chords end on the arcs: only rounding differs."""
    ring = canonical(gear(count, 50.0, 50.0 * (1 - depth), phase, tip))
    (round_one,) = place(Outline(rings=(ring,)), x, -3.0).rings
    corners = [(px, py) for px, py in flatten(round_one, chord_um).tolist()]
    straight = canonical(polygon(corners))
    one, other = teeth_of(round_one), teeth_of(straight)
    assert one is not None
    assert other is not None
    assert other.count == one.count == count
    assert other.center_um == pytest.approx(one.center_um, abs=1e-7)
    assert other.outer_um == pytest.approx(one.outer_um, abs=1e-7)
    assert other.root_um == pytest.approx(one.root_um, abs=1e-7)
    apart = math.remainder(other.phase_rad - one.phase_rad, math.tau / count)
    assert apart == pytest.approx(0, abs=1e-8)


def test_the_symmetry_of_teeth_is_theirs_however_they_are_drawn() -> None:
    ring = gear(18, 50.0, 45.0, 0.2, 0.4)
    straight = polygon([(x, y) for x, y in flatten(ring, 0.02).tolist()])
    assert symmetry_order(straight) == symmetry_order(ring) == 18


@pytest.mark.parametrize("grid_um", [1e-3, 1e-2])
def test_rounded_coordinates_move_a_gear_by_less_than_their_grid(
    grid_um: float,
) -> None:
    """Each coordinate is off by half a grid at most, each angle by as much over R."""
    ring = gear(18, 50.0, 45.0, 0.2, 0.4)
    corners = np.round(flatten(ring, 0.01) / grid_um) * grid_um
    found = teeth_of(polygon([(float(x), float(y)) for x, y in corners]))
    assert found is not None
    assert found.count == 18
    assert math.hypot(*found.center_um) < grid_um
    assert abs(found.outer_um - 50) < grid_um
    assert abs(found.root_um - 45) < grid_um
    assert abs(found.phase_rad - 0.2) * 45 < grid_um


def test_a_long_tooth_does_not_move_the_others() -> None:
    points: list[Point] = [
        (x, y) for x, y in flatten(gear(18, 50.0, 45.0, 0.0, 0.4), 0.01).tolist()
    ]
    longer = [
        (1.02 * x, 1.02 * y) if math.hypot(x, y) > 49 and abs(y) < 5 and x > 0
        else (x, y)
        for x, y in points
    ]  # fmt: skip
    assert longer != points
    found = teeth_of(polygon(longer))
    assert found is not None
    assert found.count == 18
    assert found.outer_um == pytest.approx(50)
    assert found.center_um == pytest.approx((0, 0), abs=1e-7)


@pytest.mark.parametrize(
    "ring",
    [
        polygon(rectangle(9.0, 9.0)),
        polygon(slot(40.0, 12.0)),
        polygon(flatten(circle(0, 0, 9.0), 0.1).tolist()),
        polygon([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (5.0, 4.0)]),
    ],
)
def test_other_rings_have_no_teeth(ring: Ring) -> None:
    assert teeth_of(ring) is None


def test_of_two_toothed_rings_it_is_the_one_with_the_stated_count() -> None:
    rings = [gear(18, 50.0, 45.0, 0.2, 0.4), polygon(cross(30.0, 8.0)).reversed()]
    assert [teeth(rings, count).count for count in (18, 4)] == [18, 4]
    with pytest.raises(NotFoundError, match="2 of its 2 rings"):
        teeth(rings, 17)


def test_the_arms_of_a_cross_are_its_teeth() -> None:
    found = teeth_of(polygon(cross(30.0, 8.0)))
    assert found is not None
    assert (found.count, found.phase_rad) == (4, 0.0)
