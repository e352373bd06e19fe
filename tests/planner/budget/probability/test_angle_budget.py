"""The chance that an angle is kept, against draws and closed forms."""

from __future__ import annotations

import math

import mpmath  # type: ignore[import-untyped]  # has no stubs
import numpy as np
import pytest
from scipy.stats import binom, truncnorm

from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.schemas.plan.verdicts import TurnRow

SAMPLES = 1_000_000


def turning(left: float, cut: float, *rest: float) -> AngleError:
    rows = tuple(
        TurnRow(term=str(k), sigma_rad=sigma, source="test")
        for k, sigma in enumerate(rest)
    )
    return AngleError(left_rad=left, cut_rad=cut, rows=rows)


CASES = [
    (turning(1.0, 0.4, 0.2), 0.5),
    (turning(0.3, 1.0, 0.2, 0.3), 0.7),
    (turning(2.0, 1.0, 0.01), 0.99),
    (turning(1.0, math.inf, 0.5), 1.5),
    (turning(0.0, 1.0, 0.5), 1.0),
]


@pytest.mark.parametrize("index", range(len(CASES)))
def test_the_chance_is_that_of_drawing(index: int) -> None:
    job, within = CASES[index]
    rng = np.random.default_rng(index)
    left = rng.normal(0.0, job.left_rad, 4 * SAMPLES) if job.left_rad else np.zeros(1)
    left = np.resize(left[np.abs(left) <= job.cut_rad], SAMPLES)
    rest = sum(rng.normal(0.0, row.sigma_rad, SAMPLES) for row in job.rows)
    missed, p = int((np.abs(left + rest) >= within).sum()), job.beyond(within)
    share = 1e-3 / len(CASES) / 2  # one run in a thousand fails by chance
    assert 0.001 < p < 0.7
    assert binom.cdf(missed, SAMPLES, p) > share
    assert binom.sf(missed - 1, SAMPLES, p) > share
    # the spread, within five of its own standard errors
    found = float(np.std(left + rest))
    assert job.sigma_rad == pytest.approx(found, rel=5 / math.sqrt(2 * SAMPLES))


@pytest.mark.parametrize("within", [1.0, 5.0, 10.0, 24.0])
def test_tails_keep_their_digits(within: float) -> None:
    whole = turning(0.6, math.inf, 0.8).beyond(within)
    exact = mpmath.erfc(mpmath.mpf(within) / mpmath.sqrt(2))
    assert whole == pytest.approx(float(exact), rel=1e-12)
    with mpmath.workdps(30):
        cut = _quad(0.6, 0.9, 0.8, within)
    assert turning(0.6, 0.9, 0.8).beyond(within) == pytest.approx(cut, rel=1e-9)


def _quad(s: float, cut: float, t: float, within: float) -> float:
    """Return the same by adaptive quadrature of the density, 30 digits."""

    def share(m: mpmath.mpf) -> mpmath.mpf:
        sides = [mpmath.erfc((within + k * m) / t / mpmath.sqrt(2)) for k in (1, -1)]
        return mpmath.exp(-((m / s) ** 2) / 2) * (sides[0] + sides[1]) / 2

    steps = mpmath.linspace(-cut, cut, 9)
    norm = mpmath.quad(lambda m: mpmath.exp(-((m / s) ** 2) / 2), steps)
    return float(mpmath.quad(share, steps) / norm)


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 0.1, 1.0, 3.0, 30.0])
def test_the_spread_of_what_is_cut_off_is_known(ratio: float) -> None:
    exact = truncnorm(-ratio, ratio).std() if ratio > 1e-3 else ratio / math.sqrt(3)
    assert turning(1.0, ratio).sigma_rad == pytest.approx(exact, rel=1e-6)


def test_nothing_turns_what_stands_still() -> None:
    assert turning(0.0, math.inf).beyond(1e-9) == 0.0
    assert turning(0.0, 0.1).left_inside == 1.0
    assert turning(1.0, 1.0).left_inside == pytest.approx(math.erf(math.sqrt(0.5)))
    with pytest.raises(ValueError, match="positive"):
        turning(1.0, 1.0).beyond(math.nan)
