"""Offset outlines against distances on a dense raster, and Steiner's formula."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from shapely.geometry import Polygon

from microplan.arrays import FloatArray
from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment, flatten
from tests.optics.shapes import circle, disc, gear, polygon, rectangle


def _slot() -> Outline:
    """Return a stadium: two segments, two half circles, smooth joints."""
    half = math.pi / 2
    edges: tuple[Edge, ...] = (
        Segment(start=(-5.0, -2.0), end=(5.0, -2.0)),
        Arc(center=(5.0, 0.0), radius_um=2.0, start_rad=-half, sweep_rad=2 * half),
        Segment(start=(5.0, 2.0), end=(-5.0, 2.0)),
        Arc(center=(-5.0, 0.0), radius_um=2.0, start_rad=half, sweep_rad=2 * half),
    )
    return Outline(rings=(Ring(edges=edges),))


def _lens() -> Outline:
    """Return two arcs of 8 um height that meet in sharp corners at x = -8 and 8."""
    low, sweep = math.atan2(6, 8), math.pi - 2 * math.atan2(6, 8)
    edges: tuple[Edge, ...] = (
        Arc(center=(0, 6), radius_um=10, start_rad=low - math.pi, sweep_rad=sweep),
        Arc(center=(0, -6), radius_um=10, start_rad=low, sweep_rad=sweep),
    )
    return Outline(rings=(Ring(edges=edges),))


def _inside(outline: Outline, points: FloatArray) -> npt.NDArray[np.bool_]:
    """Tell which points (N, 2) have an odd number of crossings above; chords 1e-6."""
    odd = np.zeros(len(points), dtype=bool)
    for ring in outline.rings:
        corners = flatten(ring, 1e-6)
        for (x0, y0), (x1, y1) in zip(
            corners, np.roll(corners, -1, axis=0), strict=True
        ):
            spans = (x0 <= points[:, 0]) != (x1 <= points[:, 0])
            if spans.any():
                y = y0 + (points[:, 0] - x0) / (x1 - x0) * (y1 - y0)
                odd ^= spans & (y > points[:, 1])
    return odd


def _dense(outline: Outline, step_um: float) -> FloatArray:
    """Return points on all edges, `step_um` apart."""
    points = []
    for ring in outline.rings:
        for edge in ring.edges:
            t = np.linspace(0, 1, math.ceil(edge.length_um / step_um) + 1)[:, None]
            if isinstance(edge, Arc):
                angle = edge.start_rad + t * edge.sweep_rad
                unit = np.hstack([np.cos(angle), np.sin(angle)])
                points.append(np.array(edge.center) + edge.radius_um * unit)
            else:
                points.append(np.array(edge.start) * (1 - t) + np.array(edge.end) * t)
    return np.concatenate(points)


BODIES = {
    "rectangle": rectangle(-3, -2, 4, 5),
    "L": polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 7), (0, 7)]),
    "star": polygon(
        [(4, 0), (1, 1), (0, 4), (-1, 1), (-4, 0), (-1, -1), (0, -4), (1, -1)]
    ),
    "ring": Outline(rings=(circle(8.0), circle(5.0, hole=True))),
    "slot": _slot(),
    "lens": _lens(),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("distance_um", [0.4, -0.4])
def test_a_grown_body_is_all_points_within_the_distance(
    name: str, distance_um: float
) -> None:
    old, step = BODIES[name], 0.01
    new = offset(old, distance_um)
    points = np.random.default_rng(7).uniform(-10, 10, (4000, 2))
    away, _ = cKDTree(_dense(old, step)).query(points)
    signed = np.where(_inside(old, points), -away, away)
    # dense points are half a step apart at most, along the edge
    clear = np.abs(signed - distance_um) > step**2 / (8 * 0.4) + 1e-5
    assert clear.mean() > 0.95
    np.testing.assert_array_equal(
        _inside(new, points)[clear], (signed < distance_um)[clear]
    )


@settings(max_examples=40)
@given(st.floats(1e-6, 3.0))
def test_a_convex_body_grows_by_steiners_formula(d: float) -> None:
    for body in (BODIES["rectangle"], BODIES["slot"], BODIES["lens"], disc(4.0)):
        grown = offset(body, d)
        exact = body.area_um2 + body.perimeter_um * d + math.pi * d**2
        assert grown.area_um2 == pytest.approx(exact, rel=1e-12)


def test_arcs_stay_arcs_and_corners_follow_the_stated_rule() -> None:
    grown, shrunk = offset(BODIES["L"], 0.5), offset(BODIES["L"], -0.5)
    kinds = [isinstance(e, Arc) for e in grown.rings[0].edges]
    assert kinds.count(True) == 5  # five corners rounded
    assert kinds.count(False) == 6  # and one cut
    assert sum(isinstance(e, Arc) for e in shrunk.rings[0].edges) == 1
    assert grown.area_um2 == pytest.approx(
        # growth, five quarter discs, and the inner corner's square counted twice
        22 + 26 * 0.5 + 5 * math.pi / 4 * 0.25 - 0.25,
        abs=1e-12,
    )
    (outer, hole) = offset(BODIES["ring"], 0.25).rings
    radii = [e.radius_um for r in (outer, hole) for e in r.edges if isinstance(e, Arc)]
    assert radii == [8.25, 4.75]
    assert outer.signed_area_um2 > 0 > hole.signed_area_um2


def test_a_smooth_joint_stays_smooth() -> None:
    for d in (0.3, -0.3):
        edges = offset(BODIES["slot"], d).rings[0].edges
        assert len(edges) == 4
        assert [e.radius_um for e in edges if isinstance(e, Arc)] == [2 + d] * 2


@settings(max_examples=30)
@given(st.floats(1e-4, 0.3))
def test_growing_what_was_shrunk_gives_convex_bodies_back(d: float) -> None:
    for body in (BODIES["rectangle"], BODIES["slot"], BODIES["ring"]):
        bound = body.area_um2 - (4 - math.pi) * d**2  # of corners that were rounded
        again = offset(offset(body, -d), d)
        assert bound - 1e-9 <= again.area_um2 <= body.area_um2 + 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_random_polygons_agree_with_shapely_or_are_refused(seed: int) -> None:
    rng, kept = np.random.default_rng(seed), 0
    for _ in range(25):
        count = int(rng.integers(3, 14))
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
        radius = rng.uniform(2, 10, count)
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        rival = Polygon(points)
        if np.diff([*angle, angle[0] + 2 * np.pi]).max() > 3:
            continue  # the axis is outside, the polygon may be the wrong way round
        distance_um = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-2, 0.3))
        try:
            found = offset(polygon([(x, y) for x, y in points.tolist()]), distance_um)
        except ValueError:
            continue
        kept += 1
        # shapely's quarter circles have 512 chords: short by 1.6e-6 of d**2 each
        atol = 4 * count * 1.6e-6 * distance_um**2 + 1e-9
        exact = rival.buffer(distance_um, quad_segs=512).area
        assert found.area_um2 == pytest.approx(exact, abs=atol)
    assert kept >= 10  # refusals are the exception


def test_the_gear_grows_by_its_perimeter() -> None:
    body, d = gear(), 0.05
    change = offset(body, d).area_um2 - offset(body, -d).area_um2
    # corners give +- of the order d**2 each, 72 of them, and cancel in part
    assert change == pytest.approx(2 * d * body.perimeter_um, abs=72 * d**2)


def test_no_offset_gives_the_same_object() -> None:
    body, empty = gear(), Outline(rings=())
    assert offset(body, 0.0) is body
    assert offset(empty, 1.0) is empty


@pytest.mark.parametrize(
    ("body", "distance_um", "message"),
    [
        (disc(2.0), -2.0, "radius 2.0 um vanishes"),
        (BODIES["ring"], 5.0, "radius 5.0 um vanishes"),
        (BODIES["ring"], -1.6, "wall or gap .* narrower"),
        (BODIES["rectangle"], -3.5, "vanishes"),
        (BODIES["rectangle"], -4.0, "vanishes"),
        (BODIES["slot"], -2.0, "vanishes"),
        (BODIES["lens"], -4.01, r"no longer meet|vanishes"),
        (
            Outline(rings=(circle(5.0), circle(5.0, (10.5, 0.0)))),
            0.3,
            "wall or gap .* narrower",
        ),
        (
            Outline(rings=(*rectangle(0, 0, 5, 9).rings, *disc(4, (9.4, 4.1)).rings)),
            0.3,
            "wall or gap .* narrower",
        ),
        (
            polygon(
                [(0, 0), (9, 0), (9, 5), (4.2, 5), (4.2, 1), (4, 1), (4, 5), (0, 5)]
            ),
            0.11,
            "vanishes",
        ),
    ],
)
def test_an_offset_that_changes_the_shape_is_refused(
    body: Outline, distance_um: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        offset(body, distance_um)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_distance_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="distance_um must be finite"):
        offset(disc(1.0), value)


def test_small_gaps_of_a_drawing_do_not_grow() -> None:
    gap = 9e-5
    edges: tuple[Edge, ...] = (
        Segment(start=(0.0, 0.0), end=(4.0, 0.0)),
        Arc(
            center=(4.0, 2.0 + gap),
            radius_um=2.0,
            start_rad=-math.pi / 2,
            sweep_rad=math.pi,
        ),
        Segment(start=(4.0, 4.0), end=(0.0, 4.0)),
        Segment(start=(0.0, 4.0 + gap), end=(0.0, gap)),
    )
    body = Outline(rings=(Ring(edges=edges),))
    for d in (0.5, -0.5):
        assert offset(body, d).area_um2 == pytest.approx(
            body.area_um2 + d * body.perimeter_um, abs=0.25 * 4
        )
