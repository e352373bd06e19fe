"""Bounds of rates, spreads and means."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, chi2, trim_mean, ttest_1samp

from microplan.featuresel.trials.bounds import (
    Estimate,
    estimate,
    failure_upper,
    freedom,
    half_width,
    kurtosis,
    success_lower,
)


def test_299_trials_without_failure_show_99_percent() -> None:
    assert success_lower(299, 299) == pytest.approx(0.05 ** (1 / 299), rel=1e-12)
    assert success_lower(299, 299) > 0.99 > success_lower(298, 298)


@given(trials=st.integers(1, 2000), share=st.floats(0, 1), level=st.floats(0.6, 0.9999))
def test_bounds_are_those_of_scipys_binomial_test(
    trials: int, share: float, level: float
) -> None:
    count = round(share * trials)
    two_sided = binomtest(count, trials).proportion_ci(2 * level - 1, "exact")
    assert success_lower(count, trials, level) == pytest.approx(two_sided.low, abs=1e-9)
    assert failure_upper(count, trials, level) == pytest.approx(
        two_sided.high, abs=1e-9
    )


@pytest.mark.parametrize(("count", "trials"), [(-1, 5), (6, 5), (0, 0)])
def test_counts_must_fit(count: int, trials: int) -> None:
    with pytest.raises(ValueError, match="trials"):
        success_lower(count, trials)
    with pytest.raises(ValueError, match="trials"):
        failure_upper(count, trials)


def test_of_short_tails_all_but_one_value_are_free() -> None:
    rng = np.random.default_rng(1)
    assert freedom(50, kurtosis(rng.uniform(size=50))) == 49
    assert freedom(2, kurtosis(np.array([1.0, 2.0]))) == 1
    assert freedom(9, kurtosis(np.zeros(9))) == 8
    # kurtosis of a Laplace distribution is 6: 2 N / (6 - 1) in the limit
    many = 200_000
    tails = kurtosis(rng.laplace(size=many))
    assert freedom(many, tails) / many == pytest.approx(0.4, rel=0.05)


def test_a_sigma_bound_of_short_tails_is_the_chi_square_one() -> None:
    values = np.linspace(-1, 1, 33)
    found = _sure(values)
    expected = found.sigma * np.sqrt(32 / chi2.ppf(0.05, 32))
    assert found.sigma_upper == pytest.approx(expected, rel=1e-12)
    assert found.sigma_lower < found.sigma < found.sigma_upper


def test_needs_are_in_order() -> None:
    found = _sure(np.random.default_rng(2).normal(0.3, 1.0, 64))
    assert found.need_lower < found.need < found.need_upper
    assert found.need == pytest.approx(2 * found.sigma + abs(found.mean))


@pytest.mark.parametrize("count", [24, 64, 304])
@pytest.mark.parametrize("kind", ["normal", "uniform", "mixed"])
def test_bounds_hold_for_normal_short_and_mixed_errors(kind: str, count: int) -> None:
    """A mixture of widths 1 and 2, as of two focus heights, has a kurtosis of 4.1."""
    rng = np.random.default_rng(4)
    repeats = 400
    values = rng.normal(size=(repeats, count))
    true = 1.0
    if kind == "uniform":
        values, true = rng.uniform(-1, 1, (repeats, count)), 3**-0.5
    elif kind == "mixed":
        values *= rng.choice([1.0, 2.0], (repeats, count))
        true = 2.5**0.5
    found = [_sure(row) for row in values]
    # 5 % may be broken, and by chance up to the 99.9 % quantile of the binomial. The
    # kurtosis of a mixture is not known well from few values: up to 7 % of 24
    share = 0.07 if kind == "mixed" else 0.05
    most = binom.ppf(0.999, repeats, share)
    assert sum(f.sigma_upper < true for f in found) <= most
    assert sum(f.sigma_lower > true for f in found) <= most
    assert sum(f.mean + f.mean_reach < 0 for f in found) <= most


def test_one_value_has_no_spread() -> None:
    assert estimate(np.array([1.0])) is None


def _sure(values: np.ndarray) -> Estimate:
    found = estimate(values)
    assert found is not None
    return found


@pytest.mark.parametrize("count", [5, 24, 64, 305])
def test_freedom_is_that_of_the_kurtosis_about_a_trimmed_mean(count: int) -> None:
    values = np.random.default_rng(count).standard_t(4, count)
    middle = trim_mean(values, min(0.5 / np.sqrt(count - 4), 0.49))
    fourth = count * ((values - middle) ** 4).sum()
    tails = fourth / ((values - values.mean()) ** 2).sum() ** 2
    excess = tails - (count - 3) / (count - 1)
    expected = max(1.0, min(count - 1.0, 2 * count / excess))
    assert kurtosis(values) == pytest.approx(tails, rel=1e-12)
    assert freedom(count, tails) == pytest.approx(expected, rel=1e-12)


def test_the_half_width_of_a_mean_is_that_of_students_interval() -> None:
    values = np.random.default_rng(4).normal(1.0, 2.0, 40)
    low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert half_width(_sure(values)) == pytest.approx((high - low) / 2, rel=1e-9)
