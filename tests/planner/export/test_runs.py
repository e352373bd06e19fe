"""Stretches along closed lines, and edges cut out of rings."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Ring, Segment, flatten
from microplan.planner.export.sequence import MOST_PLANES, planes_um
from microplan.planner.export.tracks import RingTrack, border, runs

PIE = Ring(  # a half disc: an arc and a chord
    edges=(
        Arc(center=(1.0, 2.0), radius_um=3.0, start_rad=0.0, sweep_rad=math.pi),
        Segment(start=(-2.0, 2.0), end=(4.0, 2.0)),
    )
)
LINE = RingTrack(PIE)


@given(st.lists(st.integers(-2, 2), min_size=1, max_size=40), st.integers(0, 5))
def test_runs_cover_a_line_once_and_never_change_what_is_not_seen(
    kinds: list[int], least: int
) -> None:
    found = runs(np.array(kinds), least)
    told = np.full(len(kinds), 9)
    for run in found:
        where = np.arange(run.first, run.last + 1) % len(kinds)
        assert (told[where] == 9).all()
        told[where] = run.kind
    assert (told != 9).all()
    assert ((told < 0) == (np.array(kinds) < 0)).all()
    assert (told[told < 0] == np.array(kinds)[np.array(kinds) < 0]).all()
    pairs = list(zip(found, found[1:] + found[:1], strict=True))
    assert len(found) == 1 or all(a.kind != b.kind for a, b in pairs)
    for before, run, after in zip(
        found[-1:] + found[:-1], found, found[1:] + found[:1], strict=True
    ):
        alike = len(found) > 1 and before.kind == after.kind
        assert not (alike and before.kind >= 0 <= run.kind and run.samples < least)


def test_a_run_may_go_on_over_the_start() -> None:
    found = runs(np.array([1, 1, 2, 2, 2, 1]), 1)
    assert [(r.kind, r.first, r.last) for r in found] == [(2, 2, 4), (1, 5, 7)]


def test_a_border_is_found_to_rounding() -> None:
    ends = np.array([0.3, 2.0 / 3.0])
    found = border(lambda x: x < ends, np.zeros(2), np.ones(2))
    np.testing.assert_allclose(found, ends, atol=1e-7)


@given(st.floats(0.0, 0.999), st.floats(0.001, 1.0))
def test_a_stretch_is_as_long_as_it_should_be_and_lies_on_the_ring(
    first: float, share: float
) -> None:
    length = LINE.length_um
    assert length == pytest.approx(3 * math.pi + 6)
    begin, end = first * length, (first + share) * length
    edges = LINE.stretch(begin, end)
    assert sum(edge.length_um for edge in edges) == pytest.approx(
        share * length, abs=1e-5
    )
    for before, after in pairwise(edges):
        assert math.dist(before.end, after.start) < 1e-5
    ends = LINE.along(np.array([begin, end]))[:, :2]
    assert math.dist(edges[0].start, ends[0]) < 1e-5
    assert math.dist(edges[-1].end, ends[1]) < 1e-5


def test_normals_lead_out_of_the_material() -> None:
    way = np.linspace(0.0, LINE.length_um, 41)[:-1] + 0.01
    polygon = flatten(PIE, 1e-4)
    points = LINE.along(way)
    for side, inside in ((0.05, False), (-0.05, True)):
        for x, y in points[:, :2] + side * points[:, 2:]:
            ahead = np.roll(polygon, -1, axis=0) - polygon
            to = np.array([x, y]) - polygon
            left = (ahead[:, 0] * to[:, 1] - ahead[:, 1] * to[:, 0] > 0).all()
            assert left == inside  # a convex polygon, run counter-clockwise


@given(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(0.01, 400.0))
def test_a_focus_stack_has_the_plans_focus_and_both_ends(
    low: float, high: float, depth: float
) -> None:
    found = planes_um(low, high, depth)
    assert found == sorted(set(found))
    assert len(found) <= MOST_PLANES
    assert 0.0 in found
    assert found[0] == pytest.approx(min(low, 0.0), abs=1e-6)
    assert found[-1] == pytest.approx(max(high, 0.0), abs=1e-6)
    steps = np.diff(found)
    widest = max(0.5 * depth, (found[-1] - found[0]) / (MOST_PLANES - 3))
    assert (steps <= widest * (1 + 1e-6) + 1e-6).all()
