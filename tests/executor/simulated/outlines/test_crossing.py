"""Points in polygons and crossing edges, against one pair at a time."""

from __future__ import annotations

import cmath
import math
from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.crossing import (
    cross,
    distances_um,
    enclosed,
    segments,
    share_area,
)


def star(rng: np.random.Generator, count: int) -> FloatArray:
    """Return a ring about the origin that turns left, with corners in and out."""
    turns = np.sort(rng.uniform(0, math.tau, count))
    reach = rng.uniform(5, 20, count)
    return np.stack([reach * np.cos(turns), reach * np.sin(turns)], axis=1)


def turns_around(point: FloatArray, ring: FloatArray) -> int:
    """Return how often a ring goes around a point: the sum of angles seen."""
    seen = [complex(*(corner - point)) for corner in ring]
    steps = [cmath.phase(b / a) for a, b in zip(seen, seen[1:] + seen[:1], strict=True)]
    return round(sum(steps) / math.tau)


def test_points_inside_are_those_that_the_ring_goes_around() -> None:
    rng = np.random.default_rng(1)
    for count in (3, 5, 12, 60):
        ring = star(rng, count)
        points = rng.uniform(-20, 20, (200, 2))
        expected = [turns_around(point, ring) > 0 for point in points]
        np.testing.assert_array_equal(enclosed(points, ring), expected)
        assert not enclosed(points, ring[::-1]).any()  # turned inside out: nothing


def test_points_level_with_corners_count_once() -> None:
    ring = np.array([[0.0, 0.0], [4.0, 2.0], [0.0, 4.0], [1.0, 2.0]])
    points = np.array([[-1.0, 2.0], [2.0, 2.0], [5.0, 2.0], [-1.0, 0.0], [-1.0, 4.0]])
    np.testing.assert_array_equal(
        enclosed(points, ring), [False, True, False, False, False]
    )


def meets(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two segments meet, in exact fractions."""
    (ax, ay), (bx, by) = [[Fraction(float(v)) for v in p] for p in first]
    (cx, cy), (dx, dy) = [[Fraction(float(v)) for v in p] for p in second]

    def side(px: Fraction, py: Fraction, *, of_first: bool) -> int:
        x0, y0, x1, y1 = (ax, ay, bx, by) if of_first else (cx, cy, dx, dy)
        area = (x1 - x0) * (py - y0) - (px - x0) * (y1 - y0)
        return (area > 0) - (area < 0)

    if side(cx, cy, of_first=True) * side(dx, dy, of_first=True) > 0:
        return False
    if side(ax, ay, of_first=False) * side(bx, by, of_first=False) > 0:
        return False
    return all(
        max(min(p), min(q)) <= min(max(p), max(q))
        for p, q in (((ax, bx), (cx, dx)), ((ay, by), (cy, dy)))
    )


COORDINATE = st.integers(-6, 6).map(float)  # small: collinear and touching ones occur
SEGMENTS = st.lists(
    st.tuples(COORDINATE, COORDINATE, COORDINATE, COORDINATE).filter(
        lambda s: s[:2] != s[2:]
    ),
    min_size=1,
    max_size=5,
)


@settings(deadline=None, max_examples=150)
@given(first=SEGMENTS, second=SEGMENTS)
def test_segments_meet_as_in_exact_fractions(
    first: list[tuple[float, ...]], second: list[tuple[float, ...]]
) -> None:
    one, other = (np.array(s).reshape(-1, 2, 2) for s in (first, second))
    expected = any(meets(a, b) for a in one for b in other)
    assert cross(one, other) == expected


def test_many_small_edges_meet_as_each_alone() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        one = segments(star(rng, 30))
        other = segments(star(rng, 25) * 0.4 + rng.uniform(-12, 12, 2))
        expected = any(meets(a, b) for a in one for b in other)
        assert cross(one, other) == expected


def test_regions_with_holes_share_area_or_do_not() -> None:
    def square(half: float, x: float = 0.0) -> FloatArray:
        return np.array(
            [[x - half, -half], [x + half, -half], [x + half, half], [x - half, half]]
        )

    plate = (square(20.0), square(10.0))  # with a hole
    assert not share_area([square(5.0)], plate)  # in the hole
    assert share_area([square(12.0)], plate)  # over the hole's rim all around
    assert share_area([square(2.0, 15.0)], plate)  # in the material
    assert not share_area([square(2.0, 30.0)], plate)
    assert share_area([square(5.0, 20.0)], plate)
    assert share_area([square(30.0)], plate)  # all around the plate
    assert not share_area([square(40.0), square(25.0)], plate)  # a frame about it
    assert not share_area(plate, [square(40.0), square(25.0)])


def test_distances_are_those_of_dense_points() -> None:
    rng = np.random.default_rng(4)
    ring = star(rng, 15)
    points = rng.uniform(-20, 20, (50, 2))
    ends = np.roll(ring, -1, axis=0)
    shares = np.linspace(0, 1, 2001)[:, None, None]
    dense = (ring + shares * (ends - ring)).reshape(-1, 2)
    expected = [np.hypot(*(dense - point).T).min() for point in points]
    # half a spacing of 40 um / 2000, at right angles to the shortest way
    np.testing.assert_allclose(distances_um(points, ring), expected, atol=0.01)
