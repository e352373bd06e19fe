"""Coverage of pixels against areas and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.optics.raster import CHORD_UM, coverage
from microplan.arrays import FloatArray
from microplan.optics.outline.clip import to_edges
from microplan.optics.render.render import render
from microplan.optics.render.scene import Window
from tests.optics.shapes import disc, gear, microscope, one_layer, polygon, rectangle

COORDINATE = st.floats(-60.0, 60.0)


@given(COORDINATE, COORDINATE, st.floats(0.01, 90.0), st.floats(0.01, 90.0))
def test_a_rectangle_is_a_product_of_overlaps(
    x: float, y: float, width: float, height: float
) -> None:
    optics = microscope()
    p = optics.um_per_px

    def overlap(count: int, low: float, high: float) -> FloatArray:
        edges = (np.arange(count + 1) - count / 2) * p
        right, left = np.minimum(edges[1:], high), np.maximum(edges[:-1], low)
        return np.asarray(np.clip(right - left, 0, p), dtype=np.float64)

    across = overlap(160, x, x + width) / p
    down = overlap(120, -y - height, -y) / p
    found = coverage(rectangle(x, y, x + width, y + height), optics)
    # sums along a row of 160 numbers below 1, each rounded, of coordinates up to 160
    np.testing.assert_allclose(found, across * down[:, None], rtol=0, atol=1e-11)


@settings(max_examples=30)
@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=9))
def test_the_sum_is_the_signed_area(points: list[tuple[float, float]]) -> None:
    optics = microscope(6.9, 160, 160)  # 174 um: all points lie inside
    if len(set(points)) < len(points):
        points = list(dict.fromkeys(points)) + [(61.0, 0.0), (0.0, 61.0), (61.0, 61.0)]
    shape = polygon(points)
    found = coverage(shape, optics).sum() * optics.um_per_px**2
    assert found == pytest.approx(shape.area_um2, abs=1e-8)


@pytest.mark.parametrize("chord_um", [1e-3, 0.1])
def test_an_arc_errs_by_its_chords(chord_um: float) -> None:
    optics = microscope(6.9, 60, 60)
    fine = coverage(disc(20.0, (1.0, 2.0)), optics, chord_um=1e-6)
    found = coverage(disc(20.0, (1.0, 2.0)), optics, chord_um=chord_um)
    bound = math.sqrt(2) * chord_um / optics.um_per_px  # along a pixel's diagonal
    assert 0 < np.abs(found - fine).max() <= bound
    missing = math.pi * 400 - found.sum() * optics.um_per_px**2
    assert 0 < missing < chord_um * 40 * math.pi


def test_a_window_is_a_part_of_the_frame() -> None:
    optics = microscope()
    whole = coverage(gear(), optics)
    window = Window(row=20, column=30, rows=40, columns=50)
    # arcs that leave the window are cut as chords
    atol = 1.5 * CHORD_UM / optics.um_per_px
    np.testing.assert_allclose(
        coverage(gear(), optics, window), whole[20:60, 30:80], rtol=0, atol=atol
    )
    wide = coverage(
        to_edges(gear()), optics, Window(row=-9, column=-9, rows=140, columns=180)
    )
    np.testing.assert_allclose(wide[9:129, 9:169], whole, rtol=0, atol=atol)


def test_a_plate_covers_all_and_a_far_part_nothing() -> None:
    optics = microscope()
    np.testing.assert_allclose(
        coverage(rectangle(-1e5, -1e5, 1e5, 1e5), optics), 1.0, rtol=0, atol=1e-12
    )
    assert not coverage(disc(5.0, (1e4, 0.0)), optics).any()


def test_chords_need_a_size() -> None:
    with pytest.raises(ValueError, match="chord_um must be positive"):
        coverage(disc(5.0), microscope(), chord_um=0.0)


@pytest.mark.parametrize("magnification", [0.2, 0.7, 2.0, 6.9])
def test_it_stands_for_an_image_where_pixels_are_large(magnification: float) -> None:
    optics = microscope(magnification)
    blurred = render(one_layer(gear()), optics, focus_um=0.0)
    error = np.abs(coverage(gear(), optics) - blurred).max()
    # an edge along a pixel's border loses (1 + log(p A / wavelength)) / pi**3 of
    # wavelength / (A p) by the tails of its spread, and a corner has two edges
    airy = optics.wavelength_um / optics.aperture / optics.um_per_px
    assert error < 0.25 * airy
