"""Chaining: neither order nor direction of edges matters, and nothing is guessed."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Segment
from microplan.planner.drawings.pieces import Piece
from microplan.planner.drawings.rings import chain


def star(radii: list[float]) -> list[tuple[float, float]]:
    """Return the corners of a star-shaped polygon, counter-clockwise."""
    step = math.tau / len(radii)
    return [
        (r * math.cos(i * step + 0.1), r * math.sin(i * step + 0.1))
        for i, r in enumerate(radii)
    ]


def pieces(points: list[tuple[float, float]], seed: int) -> list[Piece]:
    """Return the polygon's edges as loose pieces, shuffled, some backwards."""
    rng = random.Random(seed)
    ends = points[1:] + points[:1]
    out = []
    for i, (start, end) in enumerate(zip(points, ends, strict=True)):
        a, b = (start, end) if rng.random() < 0.5 else (end, start)
        out.append(Piece((Segment(start=a, end=b),), False, "A", f"{i}"))
    rng.shuffle(out)
    return out


def shoelace(points: list[tuple[float, float]]) -> float:
    """Return the area of a polygon."""
    ends = points[1:] + points[:1]
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(points, ends, strict=True)) / 2


@settings(max_examples=60, deadline=None)
@given(
    radii=st.lists(st.floats(5, 50), min_size=3, max_size=40),
    seed=st.integers(0, 1000),
)
def test_shuffled_edges_form_the_same_ring(radii: list[float], seed: int) -> None:
    points = star(radii)
    found = chain(pieces(points, seed))
    assert not found.open
    assert not found.branches
    (ring,) = found.rings
    assert ring.signed_area_um2 == pytest.approx(shoelace(points), rel=1e-9)
    assert ring == chain(pieces(points, seed + 1)).rings[0]


@settings(max_examples=40, deadline=None)
@given(
    radii=st.lists(st.floats(5, 50), min_size=4, max_size=20),
    seed=st.integers(0, 1000),
)
def test_a_missing_edge_leaves_two_ends(radii: list[float], seed: int) -> None:
    loose = pieces(star(radii), seed)
    gone = loose.pop().edges[0]
    ends = {(end.x_um, end.y_um) for end in chain(loose).open}
    assert ends == {gone.start, gone.end}


@settings(max_examples=40, deadline=None)
@given(cuts=st.lists(st.floats(0.01, 0.99), min_size=1, max_size=12, unique=True))
def test_a_split_circle_is_a_circle_again(cuts: list[float]) -> None:
    angles = sorted(math.tau * cut for cut in cuts)
    ends = [*angles[1:], angles[0] + math.tau]
    loose = [
        Piece(
            (Arc(center=(7, 3), radius_um=25, start_rad=a, sweep_rad=b - a),),
            False,
            "A",
            "",
        )
        for a, b in zip(angles, ends, strict=True)
        if b - a > 1e-4  # shorter ones are dropped as points where entities are read
    ]
    if len(loose) < len(cuts):
        return
    (ring,) = chain(loose).rings
    (edge,) = ring.edges
    assert edge == Arc(center=(7, 3), radius_um=25, start_rad=0, sweep_rad=math.tau)


def test_many_tiny_gaps_do_not_add_up() -> None:
    step = math.tau / 400
    loose = [
        Piece(
            (Arc(center=(0, 0), radius_um=50, start_rad=k * step,
                 sweep_rad=step - 1e-6),), False, "A", f"{k}",
        )
        for k in range(400)
    ]  # fmt: skip
    found = chain(loose)  # each gap is 0.05 nm, below what a ring allows
    assert found.gaps_um == ()
    assert found.rings[0].signed_area_um2 == pytest.approx(math.pi * 2500, rel=1e-12)


def test_a_path_that_runs_over_its_own_circle_stays_closed() -> None:
    """A quarter drawn twice, a chord between: over the seam that is 450 degrees."""
    quarter = [
        Arc(center=(0.0, 0.0), radius_um=10.0, start_rad=k * math.pi / 2,
            sweep_rad=math.pi / 2)
        for k in range(4)
    ]  # fmt: skip
    chord = Segment(start=quarter[0].end, end=quarter[0].start)
    piece = Piece(
        edges=(quarter[0], chord, *quarter), handle="1", layer="A", closed=True
    )
    (ring,) = chain([piece]).rings
    ends = [edge.end for edge in ring.edges]
    starts = [edge.start for edge in ring.edges]
    assert max(map(math.dist, ends, [*starts[1:], starts[0]])) < 1e-9
    # the circle, and what the first quarter cuts off beyond the chord
    area = math.pi * 100 + (math.pi * 100 / 4 - 50)
    assert ring.signed_area_um2 == pytest.approx(area, rel=1e-12)
