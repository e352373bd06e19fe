"""Tolerances by field."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.diff.tolerances import EXACT, TABLE, Rule, parse_rule, rule_for

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=32)
PLAIN = st.one_of(NUMBERS, st.text(max_size=4), st.booleans(), st.none())


def test_a_pattern_matches_from_the_end() -> None:
    rule = Rule(pattern="control/gain")
    assert rule.matches("steps/a/control/gain")
    assert rule.matches("control/gain")
    assert not rule.matches("steps/a/control/gain_limit")
    assert not rule.matches("steps/a/xcontrol/gain")


def test_what_a_user_states_comes_first() -> None:
    stated = parse_rule("sigma_xy_um=0.5")
    assert (
        rule_for(("steps", "a", "looks", "a", "measure", "sigma_xy_um"), [stated])
        is stated
    )
    assert rule_for(("steps", "a", "looks", "a", "measure", "sigma_xy_um")) in TABLE
    assert rule_for(("nothing", "like", "it")) is EXACT


@pytest.mark.parametrize(
    ("text", "old", "new", "same"),
    [
        ("x=0.25", 1.0, 1.25, True), ("x=0.25", 1.0, 1.26, False),
        ("x=5%", 100.0, 105.0, True), ("x=5%", 100.0, 106.0, False),
        ("x=ignore", "a", None, True), ("x=0", 1, 1, True), ("x=0", 1, 1.0, True),
        ("x=9", True, 2, False), ("x=9", "1", 1, False), ("a=b=1", 0.0, 1.0, True),
    ],
)  # fmt: skip
def test_a_stated_rule_compares_as_it_says(
    text: str, old: Any, new: Any, same: bool
) -> None:
    assert parse_rule(text).same(old, new) is same


@pytest.mark.parametrize(
    "text", ["", "x", "=1", "x=", "x=-1", "x=nan", "x=inf", "x=%", "x=-5%", "x=1e999"]
)
def test_what_is_no_rule_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        parse_rule(text)


def test_a_chance_near_one_is_a_number_of_a_sentence() -> None:
    words = Rule(pattern="reason", words=True)
    assert words.same("servo P > 0.9999 in 0.5 s", "servo P 0.9936 in 0.4 s")
    assert not words.same("servo P > 0.9999", "look P > 0.9999")


@given(PLAIN, PLAIN, st.floats(0, 1), st.floats(0, 10))
def test_comparison_is_symmetric_and_reflexive(
    old: Any, new: Any, relative: float, absolute: float
) -> None:
    rule = Rule(pattern="*", relative=relative, absolute=absolute)
    assert rule.same(old, old)
    assert rule.same(old, new) == rule.same(new, old)


@given(NUMBERS, NUMBERS, st.floats(0, 1))
def test_a_wider_tolerance_never_tells_more(
    old: float, new: float, relative: float
) -> None:
    if Rule(pattern="*", relative=relative).same(old, new):
        wider = Rule(pattern="*", relative=math.nextafter(relative, 2))
        assert wider.same(old, new)


def test_numbers_in_sentences_may_differ() -> None:
    rule = rule_for(("steps", "a", "looks", "a", "evidence", "chosen", "reason"))
    assert rule.same("chosen: 2 sigma 0.733 um", "chosen: 2 sigma 0.74 um")
    assert not rule.same("chosen: 2 sigma 0.733 um", "rejected: 2 sigma 0.733 um")
