"""The statistics behind the executor's figures, against closed forms and draws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from benchmarks.executing.final_errors import (
    CONFIDENCE,
    cut_off,
    predicted_um,
    quantile_bounds,
    share_bounds,
)


def plan(left_um: float, within_um: float, rest_um2: tuple[float, float, float]) -> Any:
    """Return as much of a plan as the prediction reads."""
    rows = [{"term": "servo", "sigma_um": left_um}]
    budget = {"rows": rows, "analysis": {"covariance_um2": list(rest_um2)}}
    return {
        "steps": [
            {"verb": "align", "control": {"tolerance_xy_um": within_um}},
            {"verb": "insert", "control": None, "budget": budget},
        ]
    }


def test_a_wide_cut_leaves_rayleighs_law() -> None:
    sigma = math.hypot(0.3, 0.4)
    found = predicted_um(plan(0.3, 100.0, (0.16, 0.0, 0.16)), 0.95)
    # a quantile of a million draws is off by .1 % (density 2 p ln p / r), three times
    assert found == pytest.approx(sigma * math.sqrt(-2 * math.log(0.05)), rel=3e-3)


def test_a_narrow_cut_leaves_an_even_disc() -> None:
    found = predicted_um(plan(0.5, 1.0, (1e-12, 0.0, 1e-12)), 0.95)
    assert found == pytest.approx(math.sqrt(0.95), rel=2e-3)


@pytest.mark.parametrize("rms_um", [0.1, 0.3, 0.45, 0.499])
def test_what_is_cut_off_has_the_spread_that_is_stated(rms_um: float) -> None:
    draws = cut_off(rms_um, 1.0, 200_000, np.random.default_rng(1))
    # the rms of 200 000 normal draws is off by 1 / sqrt(400 000)
    assert np.sqrt((draws**2).mean(axis=0)) == pytest.approx(rms_um, rel=6e-3)
    assert np.hypot(*draws.T).max() <= 1.0


def test_bounds_of_a_quantile_hold_as_often_as_they_say() -> None:
    rng, held, rounds = np.random.default_rng(2), 0, 2000
    truth = -math.log(0.05)  # of the exponential law
    for _ in range(rounds):
        low, high = quantile_bounds(rng.exponential(size=200).tolist(), 0.95)
        held += low <= truth <= high
    spread = math.sqrt(CONFIDENCE * (1 - CONFIDENCE) / rounds)
    assert CONFIDENCE - 3 * spread <= held / rounds <= 1  # whole ranks: never below


def test_bounds_of_a_share_reach_to_where_nothing_is_known() -> None:
    assert share_bounds(0, 10)[0] == 0.0
    assert share_bounds(10, 10)[1] == 1.0
    low, high = share_bounds(999, 1000)
    assert 0.994 < low < 0.999 < high < 1
