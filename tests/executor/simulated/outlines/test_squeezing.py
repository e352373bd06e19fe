"""Flat jaws turn a part until an edge lies flat, as by hand and by the compiler."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.squeezing import settled_rad, widths_um
from microplan.optics.outline.outline import Outline, Ring, Segment
from microplan.planner.assembly.holding import rests_of

EXACT = 1e-7  # rad, of a cusp found by halving


def around(sides: int, radius_um: float) -> FloatArray:
    return radius_um * directions(2 * math.pi * np.arange(sides) / sides)


def directions(angles_rad: FloatArray) -> FloatArray:
    return np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=1)


BOX = np.array([[-20.0, -15.0], [20.0, -15.0], [20.0, 15.0], [-20.0, 15.0]])


@pytest.mark.parametrize(
    ("start_deg", "flat_deg"),
    [(0, 0), (1, 0), (-30, 0), (36, 0), (38, 90), (54, 90), (89, 90), (-38, -90)],
)
def test_a_box_turns_downhill_from_its_diagonal(
    start_deg: float, flat_deg: float
) -> None:
    """The diagonal lies across the jaws at atan(30 / 40) from flat, 36.9 degrees."""
    found = settled_rad(BOX, math.radians(start_deg))
    assert found == pytest.approx(math.radians(flat_deg), abs=EXACT)


@given(st.floats(-math.pi, math.pi), st.integers(3, 12))
def test_a_regular_polygon_turns_to_its_nearest_edge(start: float, sides: int) -> None:
    """Flats stand a whole step apart, of an odd number half of one."""
    pitch = 2 * math.pi / sides / (1 + sides % 2)
    flat = math.pi / sides  # the edge after the corner on the x axis stands upright
    off = math.remainder(start - flat, pitch)
    if abs(abs(off) - pitch / 2) < 2e-3:
        return  # on the ridge: either way
    found = settled_rad(around(sides, 50.0), start)
    assert found - start == pytest.approx(-off, abs=EXACT)


@given(st.floats(-math.pi, math.pi))
def test_a_disc_of_chords_keeps_its_angle(start: float) -> None:
    """Its chords stand 4 nm over the circle, less than jaws feel."""
    assert settled_rad(around(350, 50.0), start) == start


RADII = st.one_of(st.none(), st.floats(20.0, 50.0))  # of a corner, if there is one


def corners_of(radii: list[float | None]) -> FloatArray:
    """Return corners 15 degrees apart or more, around the origin."""
    known = [i for i, r in enumerate(radii) if r is not None or i % 8 == 0]
    turns = math.pi / 12 * np.array(known)
    found = np.array([radii[i] or 30.0 for i in known])
    corners: FloatArray = found[:, None] * directions(turns)
    return corners


@given(st.lists(RADII, min_size=24, max_size=24), st.floats(-math.pi, math.pi))
def test_jaws_rest_where_the_compiler_says_that_they_may(
    radii: list[float | None], start: float
) -> None:
    """At one of its rests, and no wider than before."""
    corners = corners_of(radii)
    edges = tuple(
        Segment(start=tuple(a), end=tuple(b))
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    )
    rests = rests_of(Outline(rings=(Ring(edges=edges),)))
    settled = settled_rad(corners, start)
    before, after = widths_um(corners, np.array([start, settled]))
    assert after <= before + 1e-9
    near = min(abs(math.remainder(settled - r.theta_rad, math.pi)) for r in rests)
    assert near < 1e-5  # rests are rounded


@pytest.mark.parametrize("share", [-0.2, -0.1, -0.05, 0.05, 0.1, 0.2])
def test_jaws_do_not_climb_a_ridge_that_they_hardly_feel(share: float) -> None:
    """90 corners: flats every 4 degrees, valleys of .06 um between them."""
    flat, pitch = math.pi / 90, 2 * math.pi / 90
    found = settled_rad(around(90, 50.0), flat + share * pitch)
    assert found == pytest.approx(flat, abs=EXACT)
