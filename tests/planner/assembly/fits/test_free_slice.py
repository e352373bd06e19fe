"""Slices of the free region against closed forms and against points one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from benchmarks.compiling.outline_pairs import draw_pair, goes_in
from benchmarks.compiling.outline_shapes import cross, hollow, keyed
from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Outline, Ring
from microplan.planner.assembly.fits.convex_cover import convex_cover
from microplan.planner.assembly.fits.free_slice import Opening, Peg, free_slice
from microplan.planner.assembly.fits.half_planes import common_polygon
from microplan.planner.assembly.fits.peg_in_hole import (
    PegInHole,
    ring_points,
    slices_of,
)

CROSS = np.array(
    [(-9, -2), (-2, -2), (-2, -9), (2, -9), (2, -2), (9, -2),
     (9, 2), (2, 2), (2, 9), (-2, 9), (-2, 2), (-9, 2)], dtype=np.float64
)  # fmt: skip


def square(half: float) -> FloatArray:
    return np.array([(-half, -half), (half, -half), (half, half), (-half, half)])


def test_a_turned_square_in_a_square_leaves_a_square() -> None:
    hole, peg = Opening(Polygon(square(10.0))), Peg(square(9.0))
    for turn in (0.0, 0.03, 0.1, math.pi / 2, 0.2):
        half = 10 - 9 * (abs(math.cos(turn)) + abs(math.sin(turn)))
        area = 4 * max(half, 0.0) ** 2
        assert free_slice(hole, peg, turn).area == pytest.approx(area, abs=1e-9)


def test_a_cross_in_a_cross_is_held_by_its_arms() -> None:
    # arms of the hole are .5 wider on each side and longer: only their sides touch
    hole = Opening(Polygon(CROSS * 1.25))
    assert free_slice(hole, Peg(CROSS), 0.0).area == pytest.approx(1.0)


@pytest.mark.parametrize("gap", [1.0, 3.0, 3.56967248112171])
def test_bodies_that_touch_the_room_in_a_corner_take_nothing(gap: float) -> None:
    """Of the last gaps GEOS makes rings of three points, and refuses them."""
    hole, peg = (ring_points(cross(*size).rings[0], 0.01)
                 for size in ((25.0, 6 + gap), (25 - gap, 6.0)))  # fmt: skip
    found = free_slice(Opening(Polygon(hole)), Peg(peg), 0.0)
    assert found.area == pytest.approx((2 * gap) ** 2)


def test_a_peg_in_two_rooms_joined_by_a_neck_has_two_pieces() -> None:
    rooms = Polygon(
        [(-5, -5), (5, -5), (5, -1), (15, -1), (15, -5), (25, -5),
         (25, 5), (15, 5), (15, 1), (5, 1), (5, 5), (-5, 5)]
    )  # fmt: skip
    found = free_slice(Opening(rooms), Peg(square(4.0)), 0.0)
    pieces = shapely.get_parts(found)
    assert sorted(p.centroid.x for p in pieces) == pytest.approx([0.0, 20.0])
    assert [p.area for p in pieces] == pytest.approx([4.0, 4.0])


def test_what_stands_in_a_hole_is_kept_clear_of() -> None:
    ring = Polygon(square(10.0), holes=[square(1.0)])
    found = free_slice(Opening(ring), Peg(square(2.0)), 0.0)
    assert found.area == pytest.approx(16.0**2 - 6.0**2)


@pytest.mark.parametrize("family", ["key", "spline", "star", "L", "dumbbell"])
def test_slices_are_the_places_where_every_point_is_inside(family: str) -> None:
    rng = np.random.default_rng(5)
    shape = draw_pair(family, rng).fit.shape
    pieces = slices_of(shape).at(0.002)
    x0, y0, x1, y1 = shapely.union_all(pieces).buffer(0.05).bounds
    poses = np.column_stack(
        [rng.uniform(x0, x1, 400), rng.uniform(y0, y1, 400), np.full(400, 0.002)]
    )
    points = shapely.points(poses[:, :2])
    room = shapely.union_all(pieces)
    # arcs are polygons here: what is within a chord's depth of the edge may differ
    sure = np.asarray(shapely.distance(room.boundary, points)) > 2 * shape.chord_um
    inside = goes_in(shape.hole, shape.peg, poses, shape.angle_rad)
    held = np.asarray(shapely.contains(room, points))
    np.testing.assert_array_equal(held[sure], inside[sure])
    assert 0.02 < inside.mean() < 0.98


@pytest.mark.parametrize("reach_um", [25.0, 39.0])
def test_a_round_peg_goes_where_the_edge_is_a_radius_away(reach_um: float) -> None:
    """A bore of radius 33 um with a keyway outwards, or a key in it."""
    hole = hollow(keyed(33.0, reach_um, 8.0))
    circle = Arc(center=(0.0, 0.0), radius_um=22.0, start_rad=0.0, sweep_rad=math.tau)
    peg = Outline(rings=(Ring(edges=(circle,)),))
    shape = PegInHole(hole=hole, peg=peg)
    places = np.random.default_rng(7).uniform(-14, 14, (1000, 2))
    edge = Polygon(ring_points(hole.rings[0], 1e-4)).exterior
    apart_um = np.asarray(shapely.distance(edge, shapely.points(places)))
    free = shapely.union_all(slices_of(shape).at(0.3, peg_um=0.25))
    clear = np.abs(apart_um - 22.25) > 2 * shape.chord_um  # of where both may differ
    inside = shapely.contains_xy(free, *places[clear].T)
    assert (inside == (apart_um > 22.25)[clear]).all()
    assert 0.02 < inside.mean() < 0.98


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 25), st.integers(0, 1000))
def test_convex_pieces_cover_a_star_once(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = np.arange(count) / count * math.tau
    radii = rng.uniform(0.3, 1.0, count)
    points = radii[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
    pieces = [Polygon(piece) for piece in convex_cover(points)]
    for piece in pieces:
        assert piece.convex_hull.area == pytest.approx(piece.area)
    body = Polygon(points)
    assert sum(piece.area for piece in pieces) == pytest.approx(body.area)
    assert shapely.union_all(pieces).symmetric_difference(body).area < 1e-9


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 30), st.floats(-0.5, 1.0), st.integers(0, 1000))
def test_half_planes_leave_what_clipping_leaves(
    count: int, least: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    turns = np.sort(rng.uniform(-math.pi, math.pi, count))
    normals = np.column_stack([np.cos(turns), np.sin(turns)])
    normals = np.vstack([normals, [(1, 0), (0, 1), (-1, 0), (0, -1)]])
    reaches = np.append(rng.uniform(least, 1.5, count), [2.0] * 4)
    order = np.argsort(np.arctan2(normals[:, 1], normals[:, 0]), kind="stable")
    body: BaseGeometry = Polygon([(-2, -2), (2, -2), (2, 2), (-2, 2)])
    for (x, y), reach in zip(normals, reaches, strict=True):
        far = np.array(
            [(reach, -9.0), (reach, 9.0), (reach - 9, 9.0), (reach - 9, -9.0)]
        )
        body = body.intersection(Polygon(far @ np.array([(x, y), (-y, x)])))
    found = common_polygon(normals[order], reaches[order])
    area = 0.0 if found is None else Polygon(found).area
    assert area == pytest.approx(body.area, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 12), st.floats(0.0, 3e-16), st.floats(0.05, 1.0))
def test_half_planes_of_one_direction_count_once(
    count: int, apart: float, least: float
) -> None:
    """Edges of one side that arcs begin and end on differ by rounding only."""
    turns = np.arange(count) / count * math.tau - math.pi
    reaches = np.linspace(least, 1.0, count)
    normals = np.column_stack([np.cos(turns), np.sin(turns)])
    twice = np.repeat(turns, 3) + np.tile([0.0, apart, 2 * apart], count)
    doubled = np.column_stack([np.cos(twice), np.sin(twice)])
    once = common_polygon(normals, reaches)
    found = common_polygon(doubled, np.repeat(reaches, 3))
    assert once is not None
    assert found is not None
    assert Polygon(found).area == pytest.approx(Polygon(once).area, rel=1e-9)
