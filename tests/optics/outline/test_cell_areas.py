"""Coverage of cells against Shapely's areas, and against the benchmarks' rasteriser."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.optics.raster import coverage
from microplan.optics.outline.cell_areas import CHORD_UM, cells
from microplan.optics.outline.outline import Outline, place
from tests.optics.shapes import disc, gear, microscope, polygon, rectangle

LEFT, TOP, STEP, SHAPE = -3.1, 2.7, 0.7, (9, 11)
# cells' own corners and edges too: what lies there belongs to one of them
COORDINATE = st.one_of(
    st.floats(-12.0, 12.0),
    st.integers(-4, 15).map(lambda k: LEFT + k * STEP),
    st.integers(-4, 13).map(lambda k: TOP - k * STEP),
)


@settings(max_examples=200)
@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=3, unique=True))
def test_cells_of_a_triangle_are_its_areas(points: list[tuple[float, float]]) -> None:
    body = shapely.Polygon(points)
    ordered = points if body.exterior.is_ccw else points[::-1]
    rows, columns = np.indices(SHAPE)
    left, top = LEFT + STEP * columns, TOP - STEP * rows
    squares = shapely.box(left, top - STEP, left + STEP, top)
    expected = shapely.area(shapely.intersection(squares, body)) / STEP**2
    found = cells(polygon(ordered), LEFT, TOP, STEP, SHAPE)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "body", [place(gear(), 3.0, -2.0, 0.1), disc(9.0, (20.0, 8.0)), disc(500.0)]
)
def test_arcs_meet_another_rasteriser(body: Outline) -> None:
    optics = microscope(6.9, 160, 120)
    p = optics.um_per_px
    found = cells(body, -80 * p, 60 * p, p, (120, 160))
    expected = coverage(body, optics, chord_um=CHORD_UM)
    # chords of an arc that is cut begin where it is cut
    np.testing.assert_allclose(found, expected, rtol=0, atol=2 * CHORD_UM / p)


def test_holes_are_free_and_what_is_covered_twice_is_covered() -> None:
    outer, inner = rectangle(-3, -3, 3, 3), rectangle(-1, -1, 1, 1)
    (hole,) = inner.rings
    ring = Outline(rings=(*outer.rings, hole.reversed()))
    twice = Outline(rings=(*outer.rings, *inner.rings))
    for body, middle in ((ring, 0.0), (twice, 1.0)):
        found = cells(body, -4.0, 4.0, 0.5, (16, 16))
        assert found[8, 8] == middle
        assert (found[8, 3], found[8, 0]) == (1.0, 0.0)


def test_what_lies_beside_the_frame_covers_nothing() -> None:
    for x, y in ((30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0)):
        assert not cells(disc(9.0, (x, y)), -8.0, 8.0, 0.5, (32, 32)).any()
