"""The jackknife over blocks, against closed forms and repeats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import (
    FEWEST_BLOCKS,
    jackknife,
    jackknife_covariance,
    jackknife_vector,
)


def mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def test_the_deviation_of_a_mean_is_the_textbook_one() -> None:
    values = np.random.default_rng(1).normal(3, 2, 20).tolist()
    found = jackknife(mean, values)
    assert found.value == pytest.approx(np.mean(values))
    assert found.sigma == pytest.approx(np.std(values, ddof=1) / 20**0.5)
    assert (found.blocks, found.method) == (20, "jackknife")


def test_fewer_than_six_blocks_state_no_deviation() -> None:
    for count in range(1, FEWEST_BLOCKS):
        found = jackknife(mean, [1.0] * count)
        assert (found.value, found.sigma, found.blocks) == (1.0, None, count)
    assert jackknife(mean, [1.0] * FEWEST_BLOCKS).sigma == 0
    with pytest.raises(ValueError, match="must not be empty"):
        jackknife(mean, [])


def test_numbers_of_the_same_blocks_vary_together() -> None:
    """The covariance of two means is that of their values over their number."""
    rng = np.random.default_rng(3)
    blocks = list(rng.multivariate_normal([1, 5], [[2, 1.5], [1.5, 3]], 30))

    def means(some: Sequence[FloatArray]) -> FloatArray:
        return np.asarray(np.mean(some, axis=0), dtype=np.float64)

    found = jackknife_vector(means, blocks)
    assert found.covariance is not None
    np.testing.assert_allclose(found.covariance, np.cov(np.array(blocks).T) / 30)
    one = found.one(1)
    assert one.value == pytest.approx(np.mean(blocks, axis=0)[1])
    assert one.sigma is not None
    assert jackknife_vector(means, blocks[:5]).one(0).sigma is None


def test_a_ratio_has_the_spread_of_repeats() -> None:
    """A statistic that is no mean; pulls of 40 cases have the square 1, about."""
    pulls = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        blocks = list(zip(rng.normal(4, 1, 12), rng.normal(2, 0.2, 12), strict=True))

        def ratio(some: Sequence[tuple[float, float]]) -> float:
            return sum(a for a, _ in some) / sum(b for _, b in some)

        found = jackknife(ratio, blocks)
        assert found.sigma is not None
        pulls.append((found.value - 2) / found.sigma)
    assert np.max(np.abs(pulls)) < 4
    assert 0.4 < np.mean(np.square(pulls)) < 2.5


def test_a_value_that_is_not_finite_states_no_deviation() -> None:
    assert jackknife_covariance([np.array([np.nan])] + [np.ones(1)] * 7) is None
