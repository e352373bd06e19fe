"""Centroids and orders of symmetry, against shapely and against how rings are made."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.optics.outline.outline import (
    Arc,
    Edge,
    Outline,
    Ring,
    Segment,
    flatten,
    place,
)
from microplan.planner.task.regions.symmetry import centroid, symmetry_order
from tests.planner.chips import MOUTH, cross, rectangle, slot


def polygon(points: Sequence[Point]) -> Ring:
    """Return a ring of straight edges."""
    ends = [*points[1:], points[0]]
    edges = (Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    return Ring(edges=tuple(edges))


def circle(x: float, y: float, radius: float) -> Ring:
    """Return a ring of one arc."""
    arc = Arc(center=(x, y), radius_um=radius, start_rad=0.3, sweep_rad=math.tau)
    return Ring(edges=(arc,))


def moved(ring: Ring, x: float, y: float, theta: float) -> Ring:
    """Return a ring elsewhere."""
    (there,) = place(Outline(rings=(ring,)), x, y, theta).rings
    return there


def star(order: int, wave: Sequence[float]) -> Ring:
    """Return a ring whose radius repeats `order` times round the origin."""
    count = order * len(wave)
    radii = [wave[k % len(wave)] for k in range(count)]
    angles = [math.tau * k / count for k in range(count)]
    return polygon(
        [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    )


@settings(max_examples=25, deadline=None)
@given(
    order=st.integers(1, 24),
    x=st.floats(-500, 500),
    y=st.floats(-500, 500),
    theta=st.floats(-4, 4),
    back=st.booleans(),
)
def test_a_pattern_has_the_order_it_was_made_with(
    order: int, x: float, y: float, theta: float, back: bool
) -> None:
    """Three radii that all differ by far more than what counts as the same."""
    ring = moved(star(order, (40.0, 50.0, 46.0)), x, y, theta)
    assert symmetry_order(ring.reversed() if back else ring) == order


@pytest.mark.parametrize(
    ("points", "order"),
    [
        (rectangle(30.0, 16.0), 2),
        (rectangle(20.0, 20.0), 4),
        (slot(40.0, 12.0), 2),
        (slot(40.0, 12.0, steps=7), 2),
        (cross(30.0, 8.0), 4),
        (MOUTH, 1),
    ],
)
def test_edges_may_be_split_as_one_likes(points: list[Point], order: int) -> None:
    """Points put on edges change their number, not the shape."""
    more = list[Point]()
    for k, ((x, y), (ex, ey)) in enumerate(
        zip(points, [*points[1:], points[0]], strict=True)
    ):
        cuts = range(k % 4 + 1)
        shares = [cut / (k % 4 + 1) for cut in cuts]
        more += [(x + s * (ex - x), y + s * (ey - y)) for s in shares]
    assert symmetry_order(polygon(points)) == order
    assert symmetry_order(polygon(more)) == order


def test_a_circle_is_round_and_one_with_a_notch_has_no_symmetry() -> None:
    assert symmetry_order(circle(3.0, -4.0, 7.0)) == 0
    opened = Arc(center=(0.0, 0.0), radius_um=9.0, start_rad=0.1, sweep_rad=6.0)
    ring = Ring(edges=(opened, Segment(start=opened.end, end=opened.start)))
    assert symmetry_order(ring) == 1


@settings(max_examples=25, deadline=None)
@given(
    sweep=st.floats(0.2, 6.0),
    start=st.floats(-3, 3),
    radius=st.floats(1, 100),
    x=st.floats(-1e3, 1e3),
)
def test_the_centroid_is_that_of_a_fine_polygon(
    sweep: float, start: float, radius: float, x: float
) -> None:
    """Of a sector with a round hole: arcs both ways. Chords cut off at most 1e-7 R."""
    arc = Arc(center=(x, 5.0), radius_um=radius, start_rad=start, sweep_rad=sweep)
    edges: list[Edge] = [arc, Segment(start=arc.end, end=(x, 5.0))]
    edges.append(Segment(start=(x, 5.0), end=arc.start))
    outer = Ring(edges=tuple(edges))
    middle = start + sweep / 2
    small = radius * min(0.2, 0.2 * sweep)
    at = (x + radius / 2 * math.cos(middle), 5.0 + radius / 2 * math.sin(middle))
    hole = circle(*at, small).reversed()
    fine = shapely.Polygon(
        flatten(outer, 1e-7 * radius), [flatten(hole, 1e-7 * radius)]
    ).centroid
    assert centroid([outer, hole]) == pytest.approx(
        (fine.x, fine.y), abs=1e-6 * radius + 1e-8
    )
