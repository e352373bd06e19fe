"""The rule that chooses a chain, and its reasons."""

from __future__ import annotations

from dataclasses import replace

import pytest

from featuresel.score import Score, failure_upper, success_lower
from featuresel.select import Limits, select


def a_score(name: str, sigma_um: float = 0.1, cost: float = 1.0) -> Score:
    return Score(
        chain=tuple(name.split(">")),
        trials=64,
        success=64,
        success_lower=success_lower(64, 64),
        silent=0,
        silent_upper=failure_upper(0, 64),
        failures=(),
        bias_um=(0.0, 0.0),
        sigma_um=sigma_um,
        worst_um=3 * sigma_um,
        angles=64,
        bias_theta_rad=0.0,
        sigma_theta_rad=0.001,
        cost=cost,
    )


def with_failures(score: Score, aloud: int, silent: int) -> Score:
    success = 64 - aloud - silent
    return replace(
        score,
        success=success,
        angles=success,
        success_lower=success_lower(success, 64),
        silent=silent,
        silent_upper=failure_upper(silent, 64),
        failures=(("no_edge", aloud),) if aloud else (),
    )


def chosen(*scores: Score, tolerance_um: float = 1.0) -> tuple[str, ...] | None:
    best = select(scores, tolerance_um=tolerance_um, tolerance_theta_rad=None).chosen
    return None if best is None else best.chain


def test_the_cheapest_that_is_good_enough_wins() -> None:
    assert chosen(a_score("fine", 0.01, 5), a_score("coarse", 0.2, 1)) == ("coarse",)


def test_a_tight_tolerance_pays_for_accuracy() -> None:
    fine, coarse = a_score("fine", 0.1, 5), a_score("coarse", 0.2, 1)
    assert chosen(fine, coarse, tolerance_um=0.5) == ("fine",)  # .4 of .5 is used
    close = a_score("close", 0.15, 5)  # not 1.5 times better
    assert chosen(close, coarse, tolerance_um=0.5) == ("coarse",)


def test_equal_costs_go_by_name_and_order_does_not_matter() -> None:
    scores = [a_score("b"), a_score("a"), a_score("c")]
    assert chosen(*scores) == chosen(*reversed(scores)) == ("a",)


def test_every_rejection_has_its_reason_with_numbers() -> None:
    good = a_score("good", 0.1, 9)
    scores = [
        good,
        with_failures(a_score("silent"), 0, 1),
        with_failures(a_score("shy"), 2, 0),
        a_score("rough", 0.8),
        replace(a_score("flat"), angles=0, bias_theta_rad=None, sigma_theta_rad=None),
        replace(a_score("askew"), sigma_theta_rad=0.1),
    ]
    found = select(scores, tolerance_um=1.0, tolerance_theta_rad=0.01)
    assert found.chosen == good
    reasons = dict(found.reasons)
    assert reasons[("good",)].startswith("chosen: ")
    for name, words in {
        "silent": "1 silent failures in 64 trials",
        "shy": "success 96.9% of 64 trials, at least 98% (2 no_edge)",
        "rough": "2 sigma + |bias| is 1.6 um, tolerance 1 um",
        "flat": "gives no angle",
        "askew": "of the angle is 0.2 rad, tolerance 0.01 rad",
    }.items():
        assert reasons[(name,)].startswith("rejected: ")
        assert words in reasons[(name,)]


def test_bias_counts_like_spread() -> None:
    biased = replace(a_score("biased", 0.1), bias_um=(0.6, 0.7))
    assert chosen(biased) is None


def test_the_fallback_begins_with_another_routine() -> None:
    first, same = a_score("otsu>circle_caliper", 0.1, 1), a_score("otsu>ncc", 0.1, 2)
    other = a_score("ncc", 0.1, 9)
    found = select([first, same, other], tolerance_um=1, tolerance_theta_rad=None)
    assert found.chosen == first
    assert found.fallback == other
    lonely = select([first, same], tolerance_um=1, tolerance_theta_rad=None)
    assert lonely.fallback == same
    alone = select([first], tolerance_um=1, tolerance_theta_rad=None)
    assert alone.fallback is None


def test_when_nothing_passes_the_advice_says_what_would() -> None:
    found = select([a_score("a", 0.8)], tolerance_um=1, tolerance_theta_rad=None)
    assert found.chosen is None
    assert found.advice == "a would pass with a tolerance of 1.6 um"
    wild = with_failures(a_score("a"), 30, 0)
    found = select([wild], tolerance_um=1, tolerance_theta_rad=None)
    assert "right in 34 of 64 trials" in found.advice
    blind = replace(a_score("a"), angles=0, bias_theta_rad=None, sigma_theta_rad=None)
    found = select([blind], tolerance_um=1, tolerance_theta_rad=0.1)
    assert "symmetry" in found.advice


def test_limits_can_be_set() -> None:
    shy = with_failures(a_score("shy"), 4, 0)
    found = select(
        [shy], tolerance_um=1, tolerance_theta_rad=None, limits=Limits(success=0.9)
    )
    assert found.chosen == shy


def test_nonsense_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least one"):
        select([], tolerance_um=1, tolerance_theta_rad=None)
    with pytest.raises(ValueError, match="positive"):
        select([a_score("a")], tolerance_um=0, tolerance_theta_rad=None)
    with pytest.raises(ValueError, match="positive"):
        select([a_score("a")], tolerance_um=1, tolerance_theta_rad=float("nan"))
