"""Bounds and statistics of trials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.score import chain_cost, score
from microplan.featuresel.trials.trials import PreparedRoutines, prepare

Look = Callable[[str], LookCase]
CHAIN = ("otsu", "circle_caliper")


@pytest.fixture
def ready(look: Look) -> PreparedRoutines:
    return prepare(look("post"), [CHAIN])


def outcome(
    trial: int,
    error: tuple[float, float] | None,
    theta: float | None = None,
    **more: Any,
) -> Outcome:
    form: dict[str, Any] = {
        "chain": CHAIN,
        "trial": trial,
        "failure": None if error else "no_edge",
        "world_um": error,
        "target_um": error,
        "theta_rad": theta,
        "score": 1.0 if error else None,
        "spread_um": 0.01 if error else None,
    }
    return Outcome(**(form | more))


def test_failures_silent_failures_and_successes_are_apart(
    look: Look, ready: PreparedRoutines
) -> None:
    case = look("post")  # tolerance 1 um: more than 2 um off is wrong
    errors = [(0.1, 0.0), (-0.1, 0.2), (0.3, 0.1), (3.0, 0.0), None]
    (found,) = score(case, ready, [outcome(i, e) for i, e in enumerate(errors)])
    assert (found.trials, found.success, found.silent) == (5, 3, 1)
    assert found.failures == (("no_edge", 1),)
    assert found.bias_um == pytest.approx((0.1, 0.1))
    assert found.sigma_um == pytest.approx(np.std([0.1, -0.1, 0.3], ddof=1))
    assert found.worst_um == 3.0
    assert found.cost == chain_cost(case, ready, CHAIN) > 0
    assert found.need_um == pytest.approx(2 * 0.2 + math.hypot(0.1, 0.1))
    assert found.need_theta_rad == math.inf


def test_a_wrong_angle_is_a_silent_failure_where_it_matters(
    look: Look, ready: PreparedRoutines
) -> None:
    case = look("find_gear")  # what is prepared is not asked, but for its cost
    outcomes = [outcome(i, (0.1, 0.0), turn) for i, turn in enumerate((0.0, 0.001, 1))]
    (free,) = score(case, ready, outcomes)
    assert free.silent == 0
    (bound,) = score(replace(case, tolerance_theta_rad=0.01), ready, outcomes)
    assert (bound.success, bound.silent) == (2, 1)
    assert bound.bias_theta_rad == pytest.approx(0.0005)


def test_without_success_there_are_no_statistics(
    look: Look, ready: PreparedRoutines
) -> None:
    (found,) = score(look("post"), ready, [outcome(0, None), outcome(1, (5.0, 5.0))])
    assert found.bias_um is None
    assert found.sigma_um is None
    assert found.need_um == math.inf
    assert found.success_lower == 0.0
    assert found.need_upper_um == math.inf
    assert found.need_lower_um == 0.0
    assert found.ratio is None
    assert (found.worst_trial, found.median_trial, found.first_failing) == (1, 1, 0)


def test_a_score_names_the_trials_to_look_at(
    look: Look, ready: PreparedRoutines
) -> None:
    errors = [(0.2, 0.0), (0.1, 0.0), None, (0.9, 0.0), (0.3, 0.0)]
    (found,) = score(look("post"), ready, [outcome(i, e) for i, e in enumerate(errors)])
    assert found.worst_trial == 3
    assert found.median_trial == 0
    assert found.first_failing == 2
    (clean,) = score(look("post"), ready, [outcome(0, (0.1, 0.0))])
    assert clean.first_failing is None


def test_bounds_lie_about_the_need_and_widen_with_every_peek(
    look: Look, ready: PreparedRoutines
) -> None:
    rng = np.random.default_rng(3)
    errors = rng.normal((0.1, 0.0), (0.05, 0.1), (64, 2))
    outcomes = [outcome(i, (float(x), float(y))) for i, (x, y) in enumerate(errors)]
    (one,) = score(look("post"), ready, outcomes)
    (two,) = score(look("post"), ready, outcomes, interim_tests=3)
    assert one.x is not None
    assert one.y is not None
    assert one.sigma_um == one.y.sigma
    assert two.need_lower_um < one.need_lower_um < one.need_um
    assert one.need_um < one.need_upper_um < two.need_upper_um
    assert two.success_lower < one.success_lower
    assert two.silent_upper > one.silent_upper
    assert two.success_lower == pytest.approx((0.05 / 3) ** (1 / 64))
    with pytest.raises(ValueError, match="interim_tests"):
        score(look("post"), ready, outcomes, interim_tests=0)


def test_the_ratio_to_the_limit_counts_the_bias(
    look: Look, ready: PreparedRoutines
) -> None:
    outcomes = [outcome(i, (0.3 + 0.4 * (-1) ** i, 0.0)) for i in range(8)]
    (found,) = score(look("post"), ready, outcomes, limit_um=0.25)
    # errors of .7 and -.1: a mean of .3 and .4 about it, together .5
    assert found.rms_um == pytest.approx(0.5)
    assert found.ratio == pytest.approx(2.0)


def test_what_is_known_in_one_direction_is_judged_along_it(
    look: Look, ready: PreparedRoutines
) -> None:
    rng = np.random.default_rng(5)
    axis = 2.0
    u = np.array([math.cos(axis), math.sin(axis)])
    lengths = rng.normal(0.2, 0.05, 40)
    outcomes = [
        # the direction is the same half a turn on, and a little off at each answer
        outcome(
            i,
            (float(d * u[0]), float(d * u[1])),
            axis_rad=axis + math.pi * (i % 2) + 1e-3 * (-1) ** (i // 2),
        )
        for i, d in enumerate(lengths)
    ]
    (found,) = score(look("post"), ready, outcomes)
    assert found.x is None
    assert found.axis_rad == pytest.approx(axis - math.pi, abs=1e-3)
    assert found.sigma_um == pytest.approx(np.std(lengths, ddof=1), rel=1e-5)
    assert found.bias_um == pytest.approx(0.2 * u, abs=0.03)
    assert found.need_um == pytest.approx(
        2 * np.std(lengths, ddof=1) + abs(lengths.mean()), rel=1e-5
    )


def test_focus_zoom_and_spreads_are_scored_where_given(
    look: Look, ready: PreparedRoutines
) -> None:
    rng = np.random.default_rng(5)
    outcomes = [
        outcome(
            i,
            (float(rng.normal(0, 0.03)), float(rng.normal(0, 0.02))),
            float(rng.normal(0, 0.004)),
            z_um=float(rng.normal(0.1, 0.5)),
            zoom=float(rng.normal(0, 1e-3)),
            spread_theta_rad=0.002,
        )
        for i in range(400)
    ]
    (found,) = score(look("post"), ready, outcomes)
    # a spread of N values is known to 1 / sqrt(2 N): 4 of those
    rel = 4 / math.sqrt(800)
    assert found.z is not None
    assert found.z.sigma == pytest.approx(0.5, rel=rel)
    assert found.zoom is not None
    assert found.zoom.sigma == pytest.approx(1e-3, rel=rel)
    for calibration, factor in (
        (found.spread_x, 3.0),
        (found.spread_y, 2.0),
        (found.spread_theta, 2.0),
    ):
        assert calibration is not None
        assert calibration.factor == pytest.approx(factor, rel=rel)
        # 95 % of a normal lie within 1.96; its sample quantile is .95 +- 4 x .011
        assert 1.6 * factor < calibration.reach < 2.6 * factor
