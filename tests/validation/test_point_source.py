"""The real point source, and what finds its height, on images made up of a point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real.point_fit import (
    found_height_um,
    misfit,
    point_image,
    stated_lens,
)
from validation.point_source.series import NEAREST, noise_counts, read_series

LENS = replace(stated_lens(), wavefront=((8, 0.03), (11, 0.05)))
HEIGHTS = np.arange(-2.4, 2.41, 0.3)


def test_the_series_is_brightest_where_its_point_is_in_focus() -> None:
    series = read_series()
    assert series.shape == (25, 64, 64)
    assert series.max(axis=(1, 2)).argmax() == NEAREST
    assert abs(np.median(series[NEAREST, :8, :8])) < noise_counts(series)


def test_a_point_moved_by_pixels_moves_its_image() -> None:
    still = point_image(LENS, 0.6, np.zeros(2))
    moved = point_image(LENS, 0.6, np.array([3.0, -2.0]))
    np.testing.assert_allclose(moved, np.roll(still, (-2, 3), (0, 1)), atol=1e-5)
    assert still.sum() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("z_um", [-1.5, 1.5])
def test_the_side_of_focus_is_found_through_an_aberrated_lens(z_um: float) -> None:
    rng = np.random.default_rng(5)
    picture = 2e4 * point_image(LENS, z_um, np.array([0.3, -0.4])) + 20.0
    picture += rng.normal(0, 10.0, picture.shape)
    assert found_height_um(picture, LENS, 10.0, HEIGHTS) == pytest.approx(z_um)


def test_without_a_wavefront_both_sides_look_alike() -> None:
    plain = replace(LENS, wavefront=())
    picture = 2e4 * point_image(LENS, 1.5, np.zeros(2))
    above, below = (misfit(picture, plain, z_um, 10.0) for z_um in (1.5, -1.5))
    np.testing.assert_allclose(above, below, atol=1e-6)
