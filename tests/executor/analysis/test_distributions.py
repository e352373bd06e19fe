"""Tails by continued fractions against scipy, and against counting."""

from __future__ import annotations

import math

import pytest
from scipy import stats

from microplan.executor.analysis.distributions import (
    binomial_at_most,
    binomial_bounds,
    chi_square_above,
    chi_square_quantile,
    student_above,
    student_quantile,
)


@pytest.mark.parametrize("freedom", [1, 2, 9, 100, 5000])
@pytest.mark.parametrize("ratio", [1e-3, 0.3, 0.9, 1.0, 1.1, 2.0, 8.0])
def test_chi_square_is_scipys(freedom: int, ratio: float) -> None:
    value = freedom * ratio
    wanted = float(stats.chi2.sf(value, freedom))
    # lgamma of 2500 is 17 000 to 16 digits: the front is good to some 1e-12
    assert chi_square_above(value, freedom) == pytest.approx(
        wanted, rel=1e-10, abs=1e-15
    )


def test_chi_square_of_two_is_an_exponential() -> None:
    for value in (0.1, 1.0, 7.0, 40.0):
        assert chi_square_above(value, 2) == pytest.approx(
            math.exp(-value / 2), rel=1e-12
        )


@pytest.mark.parametrize("freedom", [1, 4, 30, 400])
@pytest.mark.parametrize("chance", [0.6, 0.9, 0.975, 0.9999])
def test_quantiles_are_scipys(freedom: int, chance: float) -> None:
    wanted = float(stats.t.ppf(chance, freedom))
    assert student_quantile(chance, freedom) == pytest.approx(
        wanted, rel=1e-8, abs=1e-7
    )
    assert student_above(wanted, freedom) == pytest.approx(1 - chance, rel=1e-8)
    assert student_above(-wanted, freedom) == pytest.approx(chance, rel=1e-8)
    wanted = float(stats.chi2.ppf(chance, freedom))
    assert chi_square_quantile(chance, freedom) == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize(
    ("trials", "chance"), [(1, 0.5), (5, 0.99), (40, 0.1), (900, 0.993)]
)
def test_the_binomial_is_what_counting_gives(trials: int, chance: float) -> None:
    total = 0.0
    for hits in range(trials + 1):
        total += (
            math.comb(trials, hits) * chance**hits * (1 - chance) ** (trials - hits)
        )
        assert binomial_at_most(hits, trials, chance) == pytest.approx(
            total, rel=1e-9, abs=1e-12
        )
    assert binomial_at_most(-1, trials, chance) == 0


@pytest.mark.parametrize(
    ("hits", "trials"), [(0, 5), (5, 5), (3, 5), (24, 24), (480, 500)]
)
def test_the_bounds_of_a_share_are_scipys(hits: int, trials: int) -> None:
    wanted = stats.binomtest(hits, trials).proportion_ci(0.95, method="exact")
    assert binomial_bounds(hits, trials, 0.95) == pytest.approx(
        (wanted.low, wanted.high), abs=1e-9
    )
