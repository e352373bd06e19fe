"""Crossings of a level against curves known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.featuresel.routines.circle.rim import crossings


def test_a_plane_is_crossed_on_its_line() -> None:
    y, x = np.mgrid[0:20, 0:30].astype(float)
    found = crossings(0.3 * (x - 7.25) + 0.1 * (y - 5.5), np.ones((20, 30), bool))
    off = 0.3 * (found.columns - 7.25) + 0.1 * (found.rows - 5.5)
    # planes are cubics: nothing but rounding is left
    np.testing.assert_allclose(off, 0, atol=1e-12)
    assert found.rising.all()
    whole_rows = found.rows[~found.along_rows]
    np.testing.assert_array_equal(whole_rows, np.round(whole_rows))


@pytest.mark.parametrize("place", np.linspace(0, 1, 7))
def test_a_cubic_edge_is_crossed_where_it_is(place: float) -> None:
    x = np.arange(40) - (20 + place)
    image = np.tile(x + 0.05 * x**2 + 0.02 * x**3, (6, 1))
    found = crossings(image, np.ones((6, 40), bool))
    # the polynomial's only real root is 0, and four values hold it whole
    np.testing.assert_allclose(found.columns, 20 + place, atol=1e-9)
    assert len(found.columns) == 6


def test_polarity_is_told_and_only_what_is_wanted_is_sought() -> None:
    y, x = np.mgrid[0:41, 0:41] - 20.3
    disc = 9.0 - np.hypot(x, y)
    found = crossings(disc, x > 0)
    across = ~found.along_rows
    assert across.any()
    assert not found.rising[across].any()  # the disc ends to the right
    assert (found.columns > 19.3).all()
    # a pair of pixels 1 px apart holds an arc of radius 9: the cubic's remainder is
    # that of r(x), whose 4th derivative is at most 3 / 9^3 where |cos| > .6 or so
    radius = np.hypot(found.columns - 20.3, found.rows - 20.3)
    steep = np.where(across, np.abs(found.columns - 20.3), np.abs(found.rows - 20.3))
    np.testing.assert_allclose(radius[steep > 0.6 * 9], 9.0, atol=1e-3)


def test_nothing_is_crossed_in_an_even_image() -> None:
    for value in (-1.0, 0.0, 1.0):
        found = crossings(np.full((9, 9), value), np.ones((9, 9), bool))
        assert len(found.columns) == 0
