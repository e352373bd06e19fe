"""Squeeze widths and their minima, against brute force and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.optics.outline.outline import Outline, Ring, Segment, flatten
from microplan.planner.assembly.shapes import (
    polygon,
    squeeze_minima_rad,
    squeeze_width_um,
    swept,
)
from tests.planner.examples import EXAMPLE, read

STEP_RAD = math.pi / 3600  # a grid of 0.05 degrees
Width = Callable[[Outline, float], float]


def ring_of(points: list[tuple[float, float]]) -> Outline:
    ends = points[1:] + points[:1]
    edges = tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    return Outline(rings=(Ring(edges=edges, layer=""),))


def rectangle(width_um: float, height_um: float) -> Outline:
    x, y = width_um / 2, height_um / 2
    return ring_of([(-x, -y), (x, -y), (x, y), (-x, y)])


@cache
def gear() -> Outline:
    return read(EXAMPLE / "task.yaml").parts["gear"].outline


def width_of_corners_um(outline: Outline, theta_rad: float) -> float:
    """Return the width along x of the turned corners themselves, no hull involved."""
    points = np.vstack([flatten(ring, 1.0) for ring in outline.rings])
    x = points[:, 0] * math.cos(theta_rad) - points[:, 1] * math.sin(theta_rad)
    return float(x.max() - x.min())


def width_of_gear_um(outline: Outline, theta_rad: float) -> float:
    """Return the width of 18 tips of 8 degrees at 50 um, in closed form."""
    off = abs(math.remainder(theta_rad, math.radians(20)))
    return 100 * math.cos(max(off - math.radians(4), 0.0))


def brute_minima_rad(outline: Outline, width: Width) -> list[float]:
    """Return the local minima of the width on a fine grid of [0, pi)."""
    turns = np.arange(0, math.pi - STEP_RAD / 2, STEP_RAD)
    widths = np.array([width(outline, t) for t in turns])
    lower = (widths < np.roll(widths, 1)) & (widths < np.roll(widths, -1))
    return [float(t) for t in turns[lower]]


def away_rad(a: float, b: float) -> float:
    """Return how far two turns are apart, modulo pi."""
    return abs(math.remainder(a - b, math.pi))


def test_a_rectangle_is_squeezed_on_its_faces() -> None:
    box = rectangle(30.0, 20.0)
    assert squeeze_minima_rad(box) == pytest.approx((0.0, math.pi / 2), abs=1e-9)
    assert squeeze_width_um(box, 0.0) == pytest.approx(30.0)
    assert squeeze_width_um(box, math.pi / 2) == pytest.approx(20.0)


def test_the_gear_is_squeezed_between_opposite_gaps() -> None:
    """A jaw lies flat on two neighbouring tips: every 20 degrees, half a pitch off."""
    found = squeeze_minima_rad(gear())
    wanted = [math.radians(20 * k + 10) for k in range(9)]
    assert found == pytest.approx(wanted, abs=1e-9)
    half = math.radians(20 / 2 - 4)  # from the middle of a gap to the tip's corner
    width = 2 * 50 * math.cos(half)
    assert [squeeze_width_um(gear(), t) for t in found] == pytest.approx([width] * 9)


SHAPES: dict[str, tuple[Callable[[], Outline], Width]] = {
    "gear": (gear, width_of_gear_um),
    "rectangle": (lambda: rectangle(30.0, 20.0), width_of_corners_um),
    "triangle": (
        lambda: ring_of([(0.0, 0.0), (40.0, 3.0), (11.0, 25.0)]),
        width_of_corners_um,
    ),
}


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_minima_are_those_of_brute_force(name: str) -> None:
    make, width = SHAPES[name]
    outline = make()
    found, brute = squeeze_minima_rad(outline), brute_minima_rad(outline, width)
    assert len(found) == len(brute)
    assert max(min(away_rad(b, f) for f in found) for b in brute) <= STEP_RAD
    for turn in found:
        # the chords of arcs lie up to 0.02 um inside on either side
        assert squeeze_width_um(outline, turn) == pytest.approx(
            width(outline, turn), abs=0.04
        )


def test_a_disc_has_no_narrowest_turn() -> None:
    post = read(EXAMPLE / "task.yaml").parts["shaft_plate"].posts["post"]
    assert squeeze_minima_rad(post.outline) == ()


@given(
    theta_rad=st.floats(-10, 10), width_um=st.floats(1, 1e4), ratio=st.floats(0.1, 1)
)
def test_the_width_of_a_rectangle_has_a_closed_form(
    theta_rad: float, width_um: float, ratio: float
) -> None:
    wanted = width_um * (abs(math.cos(theta_rad)) + ratio * abs(math.sin(theta_rad)))
    found = squeeze_width_um(rectangle(width_um, ratio * width_um), theta_rad)
    assert found == pytest.approx(wanted, rel=1e-9)


@settings(max_examples=25)  # each makes a hull
@given(theta_rad=st.floats(-4, 4))
def test_no_turn_is_narrower_than_the_narrowest_minimum(theta_rad: float) -> None:
    lowest = 100 * math.cos(math.radians(6))  # on two neighbouring tips
    assert squeeze_width_um(gear(), theta_rad) >= lowest - 0.04


def test_a_polygon_keeps_holes_and_area() -> None:
    outline = gear()
    signed = sum(ring.signed_area_um2 for ring in outline.rings)
    # the chord error of CHORD_UM along an arc of length L is below 2/3 CHORD_UM L
    assert polygon(outline).area == pytest.approx(signed, abs=2 / 3 * 0.02 * 500)
    assert not polygon(outline).contains(polygon(rectangle(1.0, 1.0)))


def test_a_swept_rectangle_is_a_larger_rectangle() -> None:
    grown = swept(polygon(rectangle(30.0, 20.0)), (-3.0, -1.0, 2.0, 5.0))
    assert grown.bounds == pytest.approx((-18.0, -11.0, 17.0, 15.0))
    assert grown.area == pytest.approx(35.0 * 26.0)
