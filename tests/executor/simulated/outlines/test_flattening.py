"""Polygons of rings err to their safe side, and offsets follow the normals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.executor.simulated.outlines.crossing import cross, enclosed, segments
from microplan.executor.simulated.outlines.fabricated import (
    fabricated_ring,
    whole_circle,
)
from microplan.executor.simulated.outlines.flattening import (
    MITRE,
    SAGITTA_UM,
    area_um2,
    centroid_um,
    drawn_area_um2,
    offset,
    polygon,
)
from tests.executor.simulated.keyed import (
    Drawn,
    Keyed,
    as_hole,
    bore_with_key,
    circle,
    d_shape,
    polyline,
    rectangle,
    rim,
    slot,
    spline,
)
from tests.executor.simulated.keyed import cross as cross_of

SHAPES = {
    "circle": circle(30.0),
    "d": d_shape(30.0, 18.0),
    "rectangle": rectangle(56.0, 22.0),
    "cross": cross_of(38.0, 13.0),
    "slot": slot(50.0, 10.0),
    "spline": spline(6, 28.0, 36.0, 8.0),
    "inner key": bore_with_key(30.0, 20.0, 8.0),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("larger", [False, True])
def test_a_polygon_errs_to_one_side_by_its_sagitta(name: str, *, larger: bool) -> None:
    shape = SHAPES[name]
    corners = polygon(shape.edges, larger=larger)
    ends = np.roll(corners, -1, axis=0)
    dense = np.concatenate([corners + t * (ends - corners) for t in (0, 0.25, 0.5)])
    x, y = dense.T
    least, most = (-1e-9, SAGITTA_UM) if larger else (-SAGITTA_UM, 1e-9)
    assert shape.holds(x, y, most).all()  # no point farther out
    assert not shape.holds(x, y, least - 1e-9).any()  # and none farther in
    assert area_um2(corners) > 0


@pytest.mark.parametrize("name", SHAPES)
def test_the_sense_in_which_a_ring_is_drawn_changes_nothing(name: str) -> None:
    edges = SHAPES[name].edges
    assert drawn_area_um2(as_hole(edges)) == pytest.approx(-drawn_area_um2(edges))
    one, other = (polygon(e, larger=True) for e in (edges, as_hole(edges)))
    assert area_um2(one) == pytest.approx(area_um2(other), rel=1e-12)
    assert not cross(segments(offset(one, 1e-6)), segments(other))


def concave_arc(radius: float) -> Drawn:
    """Return a plate 40 x 20 with a round bite out of its upper side."""
    return (
        (-20.0, -10.0, 20.0, -10.0),
        (20.0, -10.0, 20.0, 10.0),
        (20.0, 10.0, radius, 10.0),
        (0.0, 10.0, radius, 0.0, -math.pi),
        (-radius, 10.0, -20.0, 10.0),
        (-20.0, 10.0, -20.0, -10.0),
    )


@pytest.mark.parametrize("larger", [False, True])
def test_a_concave_arc_errs_to_the_safe_side_too(*, larger: bool) -> None:
    exact = 40 * 20 - math.pi * 8**2 / 2
    area = area_um2(polygon(concave_arc(8.0), larger=larger))
    assert abs(area - exact) < SAGITTA_UM * math.pi * 8
    assert (area > exact) == larger


@pytest.mark.parametrize("by", [-0.3, 0.3, 2.0])
def test_offsets_have_areas_in_closed_form(by: float) -> None:
    """Steiner's formula with sharp corners: A + L d + d^2 sum tan(turn / 2)."""
    plate = offset(polygon(rectangle(56.0, 22.0).edges, larger=True), by)
    assert area_um2(plate) == pytest.approx((56 + 2 * by) * (22 + 2 * by))
    ring = polygon(circle(30.0).edges, larger=False)
    flattened = SAGITTA_UM * math.tau * 31
    grown = area_um2(offset(ring, by))
    assert grown == pytest.approx(math.pi * (30 + by) ** 2, abs=flattened)
    # a cross: 8 corners turn left, 4 turn right, by 90 deg: 4 in sum, as a rectangle
    b, a = 6.5 + by, 38 + by
    arms = offset(polygon(SHAPES["cross"].edges, larger=True), by)
    assert area_um2(arms) == pytest.approx(4 * a * b * 2 - 4 * b * b)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("by", [-0.4, 0.4])
def test_an_offset_lies_where_the_grown_region_ends(name: str, by: float) -> None:
    """These regions grow with sharp corners: max norms across each edge."""
    shape = SHAPES[name]
    corners = offset(polygon(shape.edges, larger=False), by)
    ends = np.roll(corners, -1, axis=0)
    x, y = ((corners + ends) / 2).T  # the middles of edges
    assert shape.holds(x, y, by + 1e-9).all()
    # where straight sides meet the root, arcs are closed forms only to the sagitta
    assert not shape.holds(x, y, by - 2 * SAGITTA_UM).any()


@pytest.mark.parametrize("name", SHAPES)
def test_an_offset_and_back_is_the_same_ring(name: str) -> None:
    ring = polygon(SHAPES[name].edges, larger=True)
    back = offset(offset(ring, 0.3), -0.3)
    assert area_um2(back) == pytest.approx(area_um2(ring), rel=1e-9)


def test_an_arc_that_the_offset_consumes_is_gone() -> None:
    """A bite of radius .2 closes up when its edges move out by .3."""
    grown = offset(polygon(concave_arc(0.2), larger=True), 0.3)
    assert area_um2(grown) == pytest.approx(40.6 * 20.6, abs=0.02)
    assert area_um2(grown) <= 40.6 * 20.6 + 1e-9


def test_a_sharp_corner_is_rounded_and_stays_within_its_limit() -> None:
    needle = polygon(polyline([(0.0, -1.0), (40.0, 0.0), (0.0, 1.0)]), larger=True)
    grown = offset(needle, 0.5)
    assert grown[:, 0].max() == pytest.approx(40.5)  # a mitre would reach 60
    assert math.dist(max(map(tuple, grown)), (40.0, 0.0)) <= MITRE * 0.5


def test_what_an_offset_closes_is_no_ring_any_more() -> None:
    assert fabricated_ring(rectangle(30.0, 0.5).edges, -0.3, post=False) is None
    assert fabricated_ring(circle(0.2).edges, -0.3, post=False) is None


def test_whole_circles_keep_their_radius_and_others_have_none() -> None:
    halves = ((1.0, 2.0, 30.0, 0.5, math.pi), (1.0, 2.0, 30.0, 0.5 + math.pi, math.pi))
    assert whole_circle(halves) == (1.0, 2.0, 30.0)
    made = fabricated_ring(as_hole(halves), 0.25, post=False)
    assert made is not None
    assert (made.round_um, made.center_um) == (30.25, (1.0, 2.0))
    for shape in (d_shape(30.0, 18.0), slot(1.0, 10.0), rectangle(2.0, 2.0)):
        assert whole_circle(shape.edges) is None


@pytest.mark.parametrize("name", SHAPES)
def test_discs_are_inside_and_around(name: str) -> None:
    shape: Keyed = SHAPES[name]
    made = fabricated_ring(shape.edges, 0.0, post=True)
    assert made is not None
    x, y = rim(shape.edges, 0.1).T - np.array(made.center_um)[:, None]
    far = np.hypot(x, y)
    assert made.inner_um == pytest.approx(far.min(), abs=0.005)  # spacing^2 / 8 R
    assert made.outer_um == pytest.approx(far.max(), abs=0.005)
    assert enclosed(np.array([made.center_um]), made.corners_um)[0]


def test_the_centre_of_area_is_the_closed_form() -> None:
    """Two rectangles: 40 x 10 about y = 5 and 10 x 20 about y = 20."""
    corners = [(-20, 0), (20, 0), (20, 10), (5, 10), (5, 30), (-5, 30), (-5, 10),
               (-20, 10)]  # fmt: skip
    ring = polygon(polyline([(1e3 + x, float(y)) for x, y in corners]), larger=True)
    middle = (400 * 5 + 200 * 20) / 600
    assert centroid_um(ring) == pytest.approx((1e3, middle))
