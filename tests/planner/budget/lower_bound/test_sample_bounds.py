"""What trials leave open of a variance, a bias and a rate, by draws from known laws."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta, binom, chi2, poisson, t

from microplan.arrays import FloatArray
from microplan.featuresel.trials.bounds import kurtosis
from microplan.planner.budget.lower_bound.sample_bounds import (
    Level,
    half_width_factor,
    sigma_factor,
    undetected_upper,
)
from microplan.schemas.plan import Repeatability

Draw = Callable[[np.random.Generator, tuple[int, int]], FloatArray]
# standard deviation 1 each; the t distribution's kurtosis is 3 + 6 / (nu - 4)
LAWS: dict[str, Draw] = {
    "normal": lambda rng, size: rng.normal(size=size),
    "uniform": lambda rng, size: rng.uniform(-math.sqrt(3), math.sqrt(3), size),
    "t, 10 degrees": lambda rng, size: rng.standard_t(10, size) / math.sqrt(10 / 8),
    "laplace": lambda rng, size: rng.laplace(scale=math.sqrt(0.5), size=size),
    # two focus heights, one four times as wide: a mixture
    "mixture": lambda rng, size: (
        rng.normal(size=size) * rng.choice([1.0, 4.0], size) / math.sqrt(8.5)
    ),
}
SETS = 400


@pytest.mark.parametrize("count", [64, 256])
@pytest.mark.parametrize("law", LAWS)
def test_the_bound_of_sigma_holds_as_often_as_it_says(law: str, count: int) -> None:
    """Of SETS samples at 5 % doubt no more than chance explains lie above.

    Long tails: 64 values do not know their kurtosis, which costs 2 % of the 5 (see
    `featuresel.trials.bounds.estimate`); of 256 it is 1 %.
    """
    doubt, more = 0.05, {64: 0.02, 256: 0.01}[count]
    draws = LAWS[law](np.random.default_rng(count), (SETS, count))
    above = sum(
        values.std(ddof=1) * sigma_factor(count, kurtosis(values), doubt) < 1
        for values in draws
    )
    allowed = doubt + (0.0 if law in {"normal", "uniform"} else more)
    assert above <= binom.ppf(0.999, SETS, allowed)


def test_of_normal_values_it_is_the_chi_square_bound() -> None:
    expected = math.sqrt(63 / chi2.ppf(0.01, 63))
    assert sigma_factor(64, 3 - 1e-9, 0.01) == pytest.approx(expected, rel=1e-6)
    # many values of a law of kurtosis 9: nu is 2 n / 8
    wide = math.sqrt(25_000 / chi2.ppf(0.01, 25_000))
    assert sigma_factor(100_000, 9.0, 0.01) == pytest.approx(wide, rel=1e-4)
    assert sigma_factor(1, 3.0, 0.01) == math.inf


@given(st.integers(2, 4000), st.floats(1, 30), st.floats(1e-4, 0.4))
def test_more_trials_and_less_confidence_narrow_every_end(
    count: int, tails: float, doubt: float
) -> None:
    factor = sigma_factor(count, tails, doubt)
    assert 1 <= sigma_factor(4 * count, tails, doubt) <= factor
    assert sigma_factor(count, tails, min(2 * doubt, 0.5)) <= factor
    assert half_width_factor(count, 2 * doubt) <= half_width_factor(count, doubt)


def test_the_half_width_is_students() -> None:
    recorded = t.ppf(0.975, 63)
    assert half_width_factor(64, 0.05) == pytest.approx(1.0)
    assert half_width_factor(64, 0.002) == pytest.approx(t.ppf(0.999, 63) / recorded)
    assert half_width_factor(1, 0.05) == math.inf


def known(trials: int, undetected: int) -> Repeatability:
    return Repeatability(
        trials=trials, answered=trials - undetected, undetected=undetected,
        sigma_um=(0.1, 0.1), kurtosis=3.0, half_width_um=(0.01, 0.01),
    )  # fmt: skip


@pytest.mark.parametrize("failed", [0, 1, 5])
def test_a_rate_is_bounded_as_poisson_and_above_clopper_and_pearson(
    failed: int,
) -> None:
    upper = undetected_upper([(1.0, known(500, failed))], 0.025)
    # the mean of which no more than `failed` has the probability of the doubt
    assert poisson.cdf(failed, 500 * upper) == pytest.approx(0.025, rel=1e-9)
    exact = beta.ppf(0.975, failed + 1, 500 - failed)
    assert exact < upper < exact * 1.02


def test_a_run_that_looks_often_fails_as_often() -> None:
    looks = [(1.0, known(64, 0)), (2.4, known(64, 0)), (1.0, known(640, 0))]
    upper = undetected_upper(looks, 0.025)
    assert upper == pytest.approx(2.4 / 64 * -math.log(0.025))
    assert undetected_upper([(1.0, known(1, 1))], 0.025) == 1.0
    assert undetected_upper([(1.0, known(0, 0))], 0.025) == 1.0
    assert undetected_upper([], 0.025) == 0.0


def test_the_rate_of_a_run_stays_below_its_bound_as_often_as_it_says() -> None:
    """Three kinds of looks, each with a rate of its own."""
    rng, rates = np.random.default_rng(5), np.array([0.004, 0.02, 0.0])
    many, trials = np.array([1.0, 2.0, 3.0]), np.array([300, 200, 100])
    true = 1 - math.prod((1 - rates) ** many)
    above = 0
    for failed in rng.binomial(trials, rates, (SETS, 3)):
        looks = [
            (m, known(int(n), int(k)))
            for m, n, k in zip(many, trials, failed, strict=True)
        ]
        above += undetected_upper(looks, 0.05) < true
    assert above <= binom.ppf(0.999, SETS, 0.05)


def test_failures_have_four_fifths_of_the_doubt_and_terms_the_rest() -> None:
    level = Level(confidence=0.9, terms=4)
    assert level.rate_doubt == pytest.approx(0.08)
    assert level.rate_doubt + 4 * level.term_doubt == pytest.approx(0.1)
    for wrong in ({"confidence": 1.0, "terms": 1}, {"confidence": 0.9, "terms": 0}):
        with pytest.raises(ValueError, match="confidence"):
            Level(**wrong)  # type: ignore[arg-type]  # of both kinds
