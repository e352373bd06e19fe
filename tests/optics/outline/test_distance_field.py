"""Distances on a grid against distances point by point."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from microplan.optics.outline.distance_field import (
    BEYOND_UM,
    STEP_UM,
    distance_field,
    even_distances,
)
from microplan.optics.outline.outline import flatten, place
from tests.optics.shapes import disc, gear, polygon, rectangle

AREA = (-70.0, -70.0, 70.0, 70.0)
RIM_UM = STEP_UM * math.sqrt(0.5) + 1e-3  # half a cell's diagonal, and chords


def test_distances_are_those_of_the_polygon() -> None:
    shape = place(gear(), 3.0, -2.0, 0.7)
    field = distance_field(shape, AREA)
    assert field is not None
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-60, 60, (2, 400)).astype(np.float32)
    found = field.at(x, y)
    shell, hole = (flatten(ring, 1e-4) for ring in shape.rings)
    solid = shapely.Polygon(shell, [hole])
    points = shapely.points(x, y)
    away = shapely.distance(solid.boundary, points)
    truth = np.where(shapely.contains(solid, points), -away, away)
    near = away < BEYOND_UM
    assert np.abs(found - truth)[near].max() < RIM_UM
    assert (found[~near] > BEYOND_UM - RIM_UM).all()


def test_a_body_that_moves_keeps_its_distances() -> None:
    """To the bit: it is the same grid, wherever the body goes."""
    one = distance_field(disc(22.0), AREA)
    other = distance_field(place(disc(22.0), 5.0, -3.0), AREA)
    assert one is not None
    assert other is not None
    assert one.values is other.values


def test_a_large_body_has_distances_where_they_are_wanted() -> None:
    """Its grid is cut, and what is wanted near by shares it."""
    radius_um, grids = 2000.0, []
    for shift in (0.0, 10.0):
        area = (1930.0 + shift, -70.0, 2070.0 + shift, 70.0)
        field = distance_field(disc(radius_um), area)
        assert field is not None
        grids.append(field.values)
        rng = np.random.default_rng(2)
        x, y = rng.uniform((1940, -60), (2060, 60), (400, 2)).T.astype(np.float32)
        truth = np.hypot(x, y) - radius_um
        near = np.abs(truth) < BEYOND_UM
        assert np.abs(field.at(x, y) - truth)[near].max() < RIM_UM
    assert grids[0] is grids[1]
    assert grids[0].size * STEP_UM**2 < 4 * 600**2  # not of all of it


def test_a_body_far_off_has_no_distances() -> None:
    assert distance_field(place(disc(5.0), 4000.0, 0.0), AREA) is None


def test_normals_point_outwards() -> None:
    field = distance_field(disc(20.0), AREA)
    assert field is not None
    angle = np.linspace(0.1, 6.1, 9)
    x, y = (20.0 * np.stack([np.cos(angle), np.sin(angle)])).astype(np.float32)
    u, v = field.normal(x, y)
    np.testing.assert_allclose(u * np.cos(angle) + v * np.sin(angle), 1.0, atol=0.05)


def test_a_doubled_vertex_is_no_corner() -> None:
    """Nor is an edge shorter than places are rounded to: it has no way of its own."""
    corners = [(-20.0, -10.0), (20.0, -10.0), (20.0, 10.0), (-20.0, 10.0)]
    again = [*corners[:2], (20.0, -10.0 + 4e-6), *corners[2:]]
    one, other = (distance_field(polygon(points), AREA) for points in (corners, again))
    assert one is not None
    assert other is not None
    assert one.grid.corners.shape == (6, 4)
    np.testing.assert_allclose(other.grid.corners, one.grid.corners, atol=1e-4)
    ways = one.grid.corners[2:].reshape(2, 2, 4)
    np.testing.assert_allclose(np.hypot(*np.moveaxis(ways, 1, 0)), 1, atol=1e-6)


@pytest.mark.parametrize("turn_rad", [0.0, 0.3])
@pytest.mark.parametrize("length_um", [100.0, 20_000.0])
def test_even_distances_follow_a_body_that_moves_by_any_little(
    length_um: float, turn_rad: float
) -> None:
    half_um = length_um / 2
    bar = rectangle(-20.0, -half_um, 20.0, half_um)
    moves_um = np.linspace(0.0, 0.02, 21)
    found = [
        even_distances(place(bar, by_um, 0.0, turn_rad), (35.0, 2.0), 0.7, (3, 3))
        for by_um in moves_um
    ]
    # the edge nearest to all nine points lies across the move
    steps = np.diff([each[1, 1] for each in found])
    np.testing.assert_allclose(steps, -0.001 * math.cos(turn_rad), rtol=0.02)
    true = 35.7 * math.cos(turn_rad) + 1.3 * math.sin(turn_rad) - 20.0
    assert found[0][1, 1] == pytest.approx(true, abs=1e-4)
