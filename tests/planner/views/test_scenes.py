"""Hidden and shaded shares are lengths of edge, whatever the edges are made of."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment
from microplan.planner.assembly.assembly import Axis4, Place, State
from microplan.planner.assembly.initial_state import initial
from microplan.planner.task.task import Task
from microplan.planner.views.scenes import EDGE_POINTS, shade_of
from microplan.planner.views.targets import shape_of
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, read

HIGH_UM = 50.0  # of the roof above the face
APERTURE = 0.42
REACH_UM = HIGH_UM * math.tan(math.asin(APERTURE))  # of its shade sideways
WIDE_UM, TALL_UM = 200.0, 40.0
STRETCH = 1.001 / EDGE_POINTS  # error of one unbroken stretch, a point on its border


def polygon_of(*points: Point) -> Outline:
    pairs = itertools.pairwise([*points, points[0]])
    edges = tuple(Segment(start=a, end=b) for a, b in pairs)
    return Outline(rings=(Ring(edges=edges),))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Outline:
    return polygon_of((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def roof_from(x_um: float) -> Outline:
    """Return a roof over everything right of a line."""
    return rectangle(x_um, -500.0, x_um + 1000.0, 500.0)


CARD = rectangle(-WIDE_UM / 2, -TALL_UM / 2, WIDE_UM / 2, TALL_UM / 2)


@cache
def example() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.fixture
def task() -> Task:
    return example()


def shares(
    task: Task, card: Outline, roof: Outline, theta_rad: float = 0.0
) -> tuple[float, float]:
    """Return what a roof hides and shades of the edges of a card below it."""
    model, state = task.parts["gear"], initial(task)
    parts = {
        name: replace(model, name=name, outline=outline, features={}, posts={},
                      thickness_um=thickness)
        for name, outline, thickness in (("card", card, 10.0),
                                         ("roof", roof, 10.0 + HIGH_UM))
    }  # fmt: skip
    low = replace(state.parts["gear"], pose=Pose(x_um=0.0, y_um=0.0), sigma_xy_um=0.0)
    turned = replace(low, pose=Pose(x_um=0.0, y_um=0.0, theta_rad=theta_rad))
    changed = replace(task, parts=parts)
    world: State = replace(
        state, stage=Axis4(), tool=None, parts={"card": turned, "roof": low}
    )
    shape = shape_of(changed, world, "card")
    assert shape is not None
    x_um, y_um = turned.pose.apply(*shape.center_um)
    spot = Place(
        name="card", owner="card", carrier="stage", z_um=10.0, sigma_xy_um=0.0,
        pose=Pose(x_um=x_um, y_um=y_um, theta_rad=theta_rad), sigma_theta_rad=0.0,
    )  # fmt: skip
    found = shade_of(changed, world, shape, spot, APERTURE, 1.0)
    return (found[0].hidden, found[0].shaded) if found else (0.0, 0.0)


def beyond(x_um: float) -> float:
    """Return the share of the card's edges right of a line that cuts its long sides."""
    return (2 * (WIDE_UM / 2 - x_um) + TALL_UM) / (2 * (WIDE_UM + TALL_UM))


@pytest.mark.parametrize("x_um", [0.0, -70.0, 55.0, 90.0])
def test_half_a_card_is_half_hidden(task: Task, x_um: float) -> None:
    hidden, shaded = shares(task, CARD, roof_from(x_um))
    assert hidden == pytest.approx(beyond(x_um), abs=STRETCH)
    assert hidden + shaded == pytest.approx(beyond(x_um - REACH_UM), abs=STRETCH)


def test_a_roof_over_the_middle_of_a_side_counts_without_a_corner(task: Task) -> None:
    """No corner is near it: corners alone would see nothing."""
    roof = rectangle(-30.0, 0.0, 10.0, 500.0)
    hidden, shaded = shares(task, CARD, roof)
    assert hidden == pytest.approx(40.0 / (2 * (WIDE_UM + TALL_UM)), abs=STRETCH)
    # above, the shade reaches out sideways; below, 20 um from the roof, less far
    above, below = 2 * REACH_UM, 2 * math.sqrt(REACH_UM**2 - (TALL_UM / 2) ** 2) + 40.0
    wanted = (above + below) / (2 * (WIDE_UM + TALL_UM))
    # three stretches: above and below reached, above hidden
    assert shaded == pytest.approx(wanted, abs=3 * STRETCH)


@settings(max_examples=20, deadline=None)
@given(theta_rad=st.floats(-3.1, 3.1))
def test_a_line_through_the_middle_hides_half_at_any_angle(theta_rad: float) -> None:
    hidden, _ = shares(example(), CARD, roof_from(0.0), theta_rad)
    assert hidden == pytest.approx(0.5, abs=STRETCH)


def test_arcs_and_straight_edges_weigh_by_length(task: Task) -> None:
    """A half disc on a flat side: the roof hides the straight edge's half."""
    side = Segment(start=(0.0, -50.0), end=(0.0, 50.0))
    bow = Arc(center=(0.0, 0.0), radius_um=50.0, start_rad=math.pi / 2,
              sweep_rad=math.pi)  # fmt: skip
    edges: tuple[Edge, ...] = (side, bow)
    card = Outline(rings=(Ring(edges=edges),))
    roof = rectangle(-20.0, -500.0, 500.0, 500.0)
    angle = math.asin(20.0 / 50.0)  # of the bow, at either end
    wanted = (100.0 + 2 * 50.0 * angle) / (100.0 + math.pi * 50.0)
    hidden, _ = shares(task, card, roof)
    assert hidden == pytest.approx(wanted, abs=STRETCH)


def test_edges_cut_in_pieces_weigh_no_more(task: Task) -> None:
    """A side drawn as 40 short edges is as long as one drawn in one stroke."""
    x0, y0, x1, y1 = CARD.bounds_um
    comb = [(x0 + (x1 - x0) * i / 40, y0) for i in range(20)]
    fine = polygon_of(*comb, (x1, y0), (x1, y1), (x0, y1))
    assert shares(task, fine, roof_from(0.0)) == pytest.approx(
        shares(task, CARD, roof_from(0.0)), abs=STRETCH
    )
