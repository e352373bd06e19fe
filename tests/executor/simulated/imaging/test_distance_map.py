"""Maps of distances against closed forms."""

from __future__ import annotations

import math

import numpy as np

from microplan.executor.simulated.imaging.solids.distance_map import (
    EXACT_UM,
    FEW,
    distance_map,
    signed_distance_um,
)
from microplan.executor.simulated.imaging.solids.plane_outline import (
    PlaneOutline,
)
from tests.executor.simulated.imaging.bodies import box, circle, outline

POINTS = np.random.default_rng(0).uniform(-30, 30, (2000, 2))


def test_a_ring_is_as_far_as_its_circles_say() -> None:
    ring = outline([circle(1, 2, 20), circle(1, 2, 12)])
    r = np.hypot(POINTS[:, 0] - 1, POINTS[:, 1] - 2)
    exact = np.maximum(r - 20, 12 - r)
    np.testing.assert_allclose(signed_distance_um(ring, *POINTS.T), exact, atol=1e-9)
    found = distance_map(ring)
    # linear between cells: a circle bends by pitch**2 / (8 radius), off its middle line
    near = np.abs(exact) < 3
    bent = found.pitch_um**2 / (8 * 9)
    np.testing.assert_allclose(
        found.exact(*POINTS[near].T), exact[near], atol=bent + 1e-5
    )
    quick = found.quick(*POINTS[near].astype(np.float32).T)
    np.testing.assert_allclose(quick, exact[near], atol=found.coarseness_um + bent)


def test_a_box_is_as_far_as_its_sides_and_corners_say() -> None:
    found = distance_map(outline([box(-10, -5, 10, 5)]))
    dx, dy = np.abs(POINTS[:, 0]) - 10, np.abs(POINTS[:, 1]) - 5
    outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
    exact = outside + np.minimum(np.maximum(dx, dy), 0)
    near = (np.abs(POINTS[:, 0]) < 20) & (np.abs(POINTS[:, 1]) < 15)
    # where two sides are equally near, the map cuts the ridge off within a cell
    np.testing.assert_allclose(
        found.exact(*POINTS[near].T), exact[near], atol=found.pitch_um / 2
    )
    nx, ny = found.normal(np.array([11.0, 0.0]), np.array([0.0, -6.0]))
    np.testing.assert_allclose(np.c_[nx, ny], [[1, 0], [0, -1]], atol=1e-3)


def test_beside_a_corner_normals_are_those_of_the_nearer_side() -> None:
    hole = [(-3.0, -7.0), (3.0, -7.0), (3.0, 7.0), (-3.0, 7.0)]
    c, s = math.cos(0.3), math.sin(0.3)
    turned = tuple((c * x - s * y, s * x + c * y) for x, y in hole)
    found = distance_map(outline([box(-20, -20, 20, 20), turned]))
    along = np.arange(0.05, 1.0, 0.1)
    u = np.r_[3 - along, np.full(along.shape, 3.02)]  # at the end, at a side
    v = np.r_[np.full(along.shape, 7.02), 7 - along]
    nx, ny = found.normal(c * u - s * v, s * u + c * v)
    end, side = (s, -c), (-c, -s)  # into the hole
    expected = [end] * len(along) + [side] * len(along)
    np.testing.assert_allclose(np.c_[nx, ny], expected, atol=0.12)


def test_an_arc_ends_where_its_ends_are() -> None:
    """A half disc: an arc and its chord."""
    half = PlaneOutline((((-8.0, 0.0, 8.0, 0.0), (0.0, 0.0, 8.0, 0.0, math.pi)),))
    x, y = POINTS.T
    arc = np.where(y > 0, np.abs(np.hypot(x, y) - 8), np.hypot(np.abs(x) - 8, y))
    chord = np.hypot(np.maximum(np.abs(x) - 8, 0), y)
    inside = (np.hypot(x, y) < 8) & (y > 0)
    exact = np.where(inside, -1, 1) * np.minimum(arc, chord)
    np.testing.assert_allclose(signed_distance_um(half, x, y), exact, atol=1e-9)


def test_cells_near_an_edge_are_exact_and_the_others_nearly() -> None:
    drawn = outline([circle(1, 0.5, 30), box(-8, -3, 4, 9)])
    found = distance_map(drawn)
    rows, columns = found.values.shape
    row, column = np.random.default_rng(1).integers(0, (rows, columns), (2000, 2)).T
    x, y = found.x_um + found.pitch_um * column, found.y_um + found.pitch_um * row
    exact = signed_distance_um(drawn, x, y)
    away = np.abs(found.values[row, column] - exact)
    near = np.abs(exact) < EXACT_UM - FEW * found.pitch_um
    assert away[near].max() < 1e-5  # of float32
    # a distance changes by no more than the way: half a coarse cell's diagonal
    assert away.max() < FEW * found.pitch_um / 2**0.5


def test_a_doubled_vertex_makes_no_corner_without_a_way() -> None:
    square = box(-20, -10, 20, 10)
    again = (*square[:2], square[1], *square[2:])
    one, other = (outline([points]).corners for points in (square, again))
    assert one.shape == (4, 6)
    np.testing.assert_array_equal(other, one)
