"""Bounds and statistics of trials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from featuresel.case import LookCase
from featuresel.routines import Artifact
from featuresel.score import failure_upper, score, success_lower
from featuresel.trials import Outcome, Prepared

Look = Callable[[str], LookCase]
CHAIN = ("otsu", "circle_caliper")
EMPTY = Artifact(parameters={})
READY = Prepared(chains=(CHAIN,), artifacts=dict.fromkeys(CHAIN, EMPTY))


def outcome(
    trial: int, error: tuple[float, float] | None, theta: float | None = None
) -> Outcome:
    return Outcome(
        chain=CHAIN,
        trial=trial,
        failure=None if error else "no_edge",
        world_um=error,
        target_um=error,
        theta_rad=theta,
        score=1.0 if error else None,
        spread_um=0.01 if error else None,
    )


def test_299_trials_without_failure_show_99_percent() -> None:
    assert success_lower(299, 299) == pytest.approx(0.05 ** (1 / 299), rel=1e-12)
    assert success_lower(299, 299) > 0.99 > success_lower(298, 298)


@given(trials=st.integers(1, 2000), share=st.floats(0, 1))
def test_bounds_are_those_of_scipys_binomial_test(trials: int, share: float) -> None:
    count = round(share * trials)
    two_sided = binomtest(count, trials).proportion_ci(0.90, "exact")
    assert success_lower(count, trials) == pytest.approx(two_sided.low, abs=1e-9)
    assert failure_upper(count, trials) == pytest.approx(two_sided.high, abs=1e-9)


@pytest.mark.parametrize(("count", "trials"), [(-1, 5), (6, 5), (0, 0)])
def test_counts_must_fit(count: int, trials: int) -> None:
    with pytest.raises(ValueError, match="trials"):
        success_lower(count, trials)


def test_failures_silent_failures_and_successes_are_apart(look: Look) -> None:
    case = look("post")  # tolerance 1 um: more than 2 um off is wrong
    errors = [(0.1, 0.0), (-0.1, 0.2), (0.3, 0.1), (3.0, 0.0), None]
    (found,) = score(case, READY, [outcome(i, e) for i, e in enumerate(errors)])
    assert (found.trials, found.success, found.silent) == (5, 3, 1)
    assert found.failures == (("no_edge", 1),)
    assert found.bias_um == pytest.approx((0.1, 0.1))
    assert found.sigma_um == pytest.approx(np.std([0.1, -0.1, 0.3], ddof=1))
    assert found.worst_um == 3.0
    assert found.cost == 4.0
    assert found.need_um == pytest.approx(2 * 0.2 + math.hypot(0.1, 0.1))
    assert found.need_theta_rad == math.inf


def test_a_wrong_angle_is_a_silent_failure_where_it_matters(look: Look) -> None:
    case = look("find_gear")
    outcomes = [outcome(i, (0.1, 0.0), turn) for i, turn in enumerate((0.0, 0.001, 1))]
    (free,) = score(case, READY, outcomes)
    assert free.silent == 0
    (bound,) = score(replace(case, tolerance_theta_rad=0.01), READY, outcomes)
    assert (bound.success, bound.silent) == (2, 1)
    assert bound.bias_theta_rad == pytest.approx(0.0005)


def test_without_success_there_are_no_statistics(look: Look) -> None:
    (found,) = score(look("post"), READY, [outcome(0, None), outcome(1, (5.0, 5.0))])
    assert found.bias_um is None
    assert found.sigma_um is None
    assert found.need_um == math.inf
    assert found.success_lower == 0.0
