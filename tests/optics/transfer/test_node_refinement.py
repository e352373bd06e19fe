"""Curves on even nodes: what is computed, what lies between, and the slopes."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from microplan.optics.transfer.node_refinement import refined

FASTEST = 0.36  # rad a node
# What a polynomial through 12 nodes two apart errs by half way between them, and one
# through 9 in its slope at the middle and at the end, of waves that fast.
BETWEEN = (2 * FASTEST) ** 12 / math.factorial(12) * (10395 / 2**6) ** 2
SLOPE = FASTEST**8 / 630  # 4!**2 / 9!
END_SLOPE = FASTEST**8 / 9  # 8! / 9!


@pytest.mark.parametrize("count", [9, 21, 31, 33, 101, 1001])
@pytest.mark.parametrize("phase", [0.0, 0.7, 1.6])
def test_waves_and_their_slopes_are_followed(count: int, phase: float) -> None:
    rate = FASTEST * (count - 1)  # rad over nodes 2..3
    values, slopes = refined(lambda x: np.cos(rate * x + phase), 2.0, 3.0, count)
    nodes = np.linspace(2.0, 3.0, count)
    assert np.abs(values - np.cos(rate * nodes + phase)).max() <= BETWEEN
    off = np.abs(slopes + rate * np.sin(rate * nodes + phase)) / rate
    # a difference of 9 values has weights of 2.1 in all, and h rad for a step
    assert off[4:-4].max() <= SLOPE + 2.1 * BETWEEN / FASTEST
    assert off.max() <= END_SLOPE


def test_polynomials_are_exact() -> None:
    powers = np.polynomial.Polynomial([0.3, -1.0, 0.2, 0.5, 0.0, -0.7, 0.1, 0.4])
    values, slopes = refined(powers, -1.0, 1.0, 65)
    nodes = np.linspace(-1.0, 1.0, 65)
    np.testing.assert_allclose(values, powers(nodes), rtol=0, atol=1e-13)
    np.testing.assert_allclose(slopes, powers.deriv()(nodes), rtol=0, atol=1e-11)


def test_half_of_the_nodes_are_computed() -> None:
    asked: list[int] = []

    def curve(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        asked.append(x.size)
        return x

    refined(curve, 0.0, 1.0, 1001)
    assert asked == [511]


@pytest.mark.parametrize("count", [7, 64])
def test_a_count_that_does_not_fit_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match="odd"):
        refined(np.sin, 0.0, 1.0, count)
