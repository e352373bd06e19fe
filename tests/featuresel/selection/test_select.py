"""The rule that chooses a chain, and its reasons."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from microplan.featuresel.routines.contract import Target
from microplan.featuresel.selection.constraints import Constraints, Limits, front
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.bounds import failure_upper, success_lower
from microplan.featuresel.trials.score import ChainScore

GEAR = Target(
    name="rim", kind="teeth", column=50.0, row=50.0, theta_rad=0.0, px_per_um=1.0,
    search_px=5.0, theta_range_rad=math.pi, symmetry=18, bright=True,
    parameters={"count": 18.0, "outer_um": 50.0, "root_um": 45.0, "phase_rad": 0.0},
)  # fmt: skip
NOTCH = {"notch_rad": 1.0, "notch_radius_um": 27.0, "notch_width_um": 6.0}


def a_score(name: str, sigma_um: float = 0.1, cost: float = 1.0) -> ChainScore:
    return ChainScore(
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


def with_failures(score: ChainScore, detected: int, silent: int) -> ChainScore:
    success = 64 - detected - silent
    return replace(
        score,
        success=success,
        angles=success,
        success_lower=success_lower(success, 64),
        silent=silent,
        silent_upper=failure_upper(silent, 64),
        failures=(("no_edge", detected),) if detected else (),
    )


def chosen(*scores: ChainScore, tolerance_um: float = 1.0) -> tuple[str, ...] | None:
    best = select(
        scores, Constraints(tolerance_um=tolerance_um, tolerance_theta_rad=None)
    ).chosen
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
    found = select(scores, Constraints(tolerance_um=1.0, tolerance_theta_rad=0.01))
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
    found = select(
        [first, same, other], Constraints(tolerance_um=1, tolerance_theta_rad=None)
    )
    assert found.chosen == first
    assert found.fallback == other
    lonely = select(
        [first, same], Constraints(tolerance_um=1, tolerance_theta_rad=None)
    )
    assert lonely.fallback == same
    alone = select([first], Constraints(tolerance_um=1, tolerance_theta_rad=None))
    assert alone.fallback is None


def test_the_fallback_is_of_another_principle() -> None:
    first, near = a_score("otsu", 0.1, 1), a_score("ncc", 0.1, 2)
    edges = replace(a_score("otsu>circle_caliper", 0.1, 5), principle="edges")
    both = replace(a_score("iso_circle", 0.1, 9), principle="edges")
    task = Constraints(tolerance_um=1, tolerance_theta_rad=None)
    assert select([first, near], task).fallback == near
    assert select([first, near, edges], task).fallback == edges
    assert select([first, near, edges, both], task).fallback == both


def test_when_nothing_passes_the_advice_says_what_would() -> None:
    found = select(
        [a_score("a", 0.8)], Constraints(tolerance_um=1, tolerance_theta_rad=None)
    )
    assert found.chosen is None
    assert found.advice == "a would pass with a tolerance of 1.6 um"
    wild = with_failures(a_score("a"), 30, 0)
    found = select([wild], Constraints(tolerance_um=1, tolerance_theta_rad=None))
    assert "right in 34 of 64 trials" in found.advice
    blind = replace(a_score("a"), angles=0, bias_theta_rad=None, sigma_theta_rad=None)
    found = select([blind], Constraints(tolerance_um=1, tolerance_theta_rad=0.1))
    assert "symmetry" in found.advice


def test_limits_can_be_set() -> None:
    shy = with_failures(a_score("shy"), 4, 0)
    found = select(
        [shy],
        Constraints(
            tolerance_um=1, tolerance_theta_rad=None, limits=Limits(success=0.9)
        ),
    )
    assert found.chosen == shy


def test_nonsense_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least one"):
        select([], Constraints(tolerance_um=1, tolerance_theta_rad=None))
    with pytest.raises(ValueError, match="positive"):
        select([a_score("a")], Constraints(tolerance_um=0, tolerance_theta_rad=None))
    with pytest.raises(ValueError, match="positive"):
        select(
            [a_score("a")],
            Constraints(tolerance_um=1, tolerance_theta_rad=float("nan")),
        )
    with pytest.raises(ValueError, match="positive"):
        select([a_score("a")], Constraints(tolerance_um=1, tolerance_theta_rad=0.0))
    with pytest.raises(ValueError, match="cost"):
        Limits(cost=0.0)
    with pytest.raises(ValueError, match="visible"):
        select(
            [a_score("a")],
            Constraints(tolerance_um=1, tolerance_theta_rad=None, visible=1.5),
        )


def test_what_costs_too_much_is_rejected_and_says_so() -> None:
    fast, slow = a_score("fast", 0.8, 1), a_score("slow", 0.1, 9)
    found = select(
        [fast, slow],
        Constraints(tolerance_um=1, tolerance_theta_rad=None, limits=Limits(cost=5)),
    )
    assert found.chosen is None
    assert dict(found.reasons)[("slow",)] == "rejected: cost 9, at most 5"
    assert found.advice == "slow would pass with a cost of 9"


def test_an_angle_that_looks_like_another_is_refused() -> None:
    score = a_score("a")
    plain = select(
        [score], Constraints(tolerance_um=1, tolerance_theta_rad=0.01, target=GEAR)
    )
    assert plain.chosen is None
    assert "not unique: nothing breaks the symmetry" in plain.reasons[0][1]
    assert "0.175 rad" in plain.advice  # half a pitch, pi / 18
    broken = replace(GEAR, parameters={**GEAR.parameters, **NOTCH})
    near = replace(GEAR, theta_range_rad=math.pi / 18 - 1e-6)
    for target in (broken, near):
        found = select(
            [score],
            Constraints(tolerance_um=1, tolerance_theta_rad=0.01, target=target),
        )
        assert found.chosen == score
    # where no angle is needed none can be mistaken
    free = select(
        [score], Constraints(tolerance_um=1, tolerance_theta_rad=None, target=GEAR)
    )
    assert free.chosen == score
    bore = replace(GEAR, kind="circle", symmetry=0, parameters={"radius_um": 25.0})
    found = select(
        [score], Constraints(tolerance_um=1, tolerance_theta_rad=0.01, target=bore)
    )
    assert "a round target has no angle" in found.reasons[0][1]


def test_what_is_hidden_is_refused() -> None:
    found = select(
        [a_score("a")],
        Constraints(tolerance_um=1, tolerance_theta_rad=None, visible=0.2),
    )
    assert found.chosen is None
    words = "20% of the target's edges are visible, at least 25%"
    assert found.reasons == ((("a",), f"rejected: {words}"),)
    assert "another feature" in found.advice


def test_one_direction_is_enough_in_a_set_only() -> None:
    edge = replace(a_score("edge"), axis_rad=0.0)
    alone = select([edge], Constraints(tolerance_um=1, tolerance_theta_rad=None))
    assert "in one direction only" in alone.reasons[0][1]
    member = select(
        [edge], Constraints(tolerance_um=1, tolerance_theta_rad=None, in_set=True)
    )
    assert member.chosen == edge


def test_the_pareto_list_is_what_nothing_beats() -> None:
    grid = [
        a_score(f"s{k}", sigma, cost)
        for k, (sigma, cost) in enumerate(
            itertools.product((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
        )
    ]
    scores = [grid[2], grid[4], grid[6], grid[8], grid[7], grid[5]]

    def beaten(s: ChainScore) -> bool:
        return any(
            o.cost <= s.cost and o.need_um <= s.need_um
            and (o.cost, o.need_um) != (s.cost, s.need_um)
            for o in scores
        )  # fmt: skip

    found = front(scores, lambda s: s.need_um)
    assert found == (grid[6], grid[4], grid[2])
    assert set(found) == {s for s in scores if not beaten(s)}
    twins = [a_score("b"), a_score("a")]
    assert front(twins, lambda s: s.need_um) == (twins[1],)
    blind = replace(a_score("c", 0.1, 0.1), bias_um=None)
    assert blind not in front([*scores, blind], lambda s: s.need_um)


def test_a_selection_lists_accuracy_against_cost() -> None:
    wild = with_failures(a_score("wild", 0.01, 0.5), 30, 0)
    scores = [a_score("fine", 0.01, 5), a_score("coarse", 0.2, 1), wild]
    found = select(scores, Constraints(tolerance_um=1.0, tolerance_theta_rad=None))
    assert found.pareto == (scores[1], scores[0])  # what fails is no way to be fast


def test_one_direction_of_two_is_no_matter_of_tolerance() -> None:
    edge = replace(a_score("line_caliper", 0.1), axis_rad=0.0)
    wide = replace(a_score("edge_pair", 5.0), axis_rad=0.0)
    for theta in (None, 0.0001):  # a tighter angle does not change what is missing
        found = select(
            [edge, wide], Constraints(tolerance_um=1.0, tolerance_theta_rad=theta)
        )
        assert found.chosen is None
        assert found.advice.startswith("reliable chains tell the place in one direct")
    both = a_score("corner", 2.0)
    found = select(
        [edge, both], Constraints(tolerance_um=1.0, tolerance_theta_rad=None)
    )
    assert found.advice == "corner would pass with a tolerance of 4 um"


def test_one_trial_tells_no_spread() -> None:
    once = replace(
        a_score("otsu"), trials=1, success=1, angles=1, bias_um=None, sigma_um=None,
        bias_theta_rad=None, sigma_theta_rad=None,
    )  # fmt: skip
    for theta in (None, 0.01):
        found = select([once], Constraints(tolerance_um=1.0, tolerance_theta_rad=theta))
        assert found.advice == "too few trials to tell a spread"
