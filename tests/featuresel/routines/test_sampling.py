"""Values between pixels, and edges along lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.featuresel.routines.sampling import (
    STEP_PX,
    WIDTHS_PX,
    best_width,
    cubic,
    edge_kernel,
    find_edges,
    line_samples,
    median,
)


def test_cubic_convolution_is_exact_for_quadratics() -> None:
    y, x = np.mgrid[0:12, 0:14].astype(float)
    rng = np.random.default_rng(1)
    columns, rows = rng.uniform(1, 12, 50), rng.uniform(1, 10, 50)

    def surface(u: FloatArray, v: FloatArray) -> FloatArray:
        return 0.3 + 0.2 * u - 0.1 * v + 0.05 * u * u - 0.02 * u * v + 0.03 * v * v

    values, inside = cubic(surface(x, y), columns, rows)
    assert inside.all()
    np.testing.assert_allclose(values, surface(columns, rows), rtol=1e-12)


def test_points_outside_are_marked_and_take_the_border() -> None:
    image = np.arange(20.0).reshape(4, 5)
    values, inside = cubic(image, np.array([-3.0, 4.0]), np.array([0.0, 3.0]))
    assert inside.tolist() == [False, True]
    np.testing.assert_allclose(values, [0.0, 19.0])


@pytest.mark.parametrize("width_px", WIDTHS_PX)
def test_edge_kernel_answers_a_unit_step_with_one(width_px: float) -> None:
    kernel = edge_kernel(width_px)
    step = (np.arange(len(kernel)) > len(kernel) // 2).astype(float)
    assert kernel @ step == pytest.approx(1.0, rel=1e-12)
    assert kernel.sum() == pytest.approx(0.0, abs=1e-12)


@given(at=st.floats(-4, 4), width=st.floats(1.5, 4), height=st.floats(0.1, 1))
def test_edges_are_found_between_pixels(at: float, width: float, height: float) -> None:
    columns = np.arange(41)
    erf = np.array([math.erf((c - 20 - at) / width / math.sqrt(2)) for c in columns])
    image = np.tile(0.1 + height * (1 + erf) / 2, (8, 1))
    x = 20 + line_samples(6, 1.2)[None, :]
    found = find_edges(image, x, np.full_like(x, 4.0), width_px=1.2, rising=True)
    assert found.found.all()
    # cubic convolution is exact to third order: what is left is the curvature of an
    # erf as narrow as 1.5 px, below a hundredth of a pixel
    assert found.offset_px[0] == pytest.approx(at, abs=0.02)
    fallen = find_edges(image, x, np.full_like(x, 4.0), width_px=1.2, rising=False)
    assert fallen.strength[0] < 0.05 * height


def test_a_line_that_leaves_the_image_finds_nothing_there() -> None:
    image = np.tile(np.repeat([0.0, 1.0], 10), (6, 1))
    x = 40 + line_samples(5, 1.2)[None, :]
    found = find_edges(image, x, np.full_like(x, 3.0), width_px=1.2, rising=True)
    assert not found.found.any()
    assert found.strength[0] == 0


def test_filter_width_follows_the_blur() -> None:
    x = np.arange(-60, 61) * STEP_PX
    blurs = (0.5, 1.5, 3.0, 5.0)
    widths = [
        best_width(np.array([math.erf(v / blur / math.sqrt(2)) for v in x]))
        for blur in blurs
    ]
    assert widths == sorted(widths)
    assert widths[0] < 1.5
    assert widths[-1] > 3


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=9))
def test_median_is_numpys(values: list[float]) -> None:
    assert median(np.array(values)) == np.median(values)
