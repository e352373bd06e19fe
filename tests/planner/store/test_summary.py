"""What is said of a plan below its steps."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.planner.store.summary import plan_summary
from microplan.schemas.plan import Plan, parse_plan
from tests.planner.examples import ROOT


@pytest.fixture(scope="module")
def golden() -> Plan:
    """Return the golden plan of the gear-on-shaft example."""
    file = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
    return parse_plan(file.read_text(encoding="utf-8"))


def _note(plan: Plan) -> str:
    """Return what a summary says of the pictures' errors."""
    return next(x for x in plan_summary(plan).splitlines() if x.startswith("note: "))


def test_what_pictures_may_err_by_names_the_look(golden: Plan) -> None:
    looks = sum(len(step.looks) for step in golden.steps)
    assert f"note: {looks} looks may err by more" in _note(golden)


@pytest.mark.parametrize(
    ("chance", "told"),
    [(0.99996, "> 0.9999"), (1.0, "> 0.9999"), (0.99994, "0.9999"), (0.5, "0.5000")],
)
def test_no_chance_is_told_as_certain(golden: Plan, chance: float, told: str) -> None:
    said = plan_summary(replace(golden, success_probability=chance))
    assert f"feasible, P(success) {told}, goal 0.95 (simulated)" in said
    assert "focus -16..+16 um; P > 0.9999\n" in said  # see_fingers: .999999


def test_a_focus_sweep_that_is_not_in_the_time_is_named(golden: Plan) -> None:
    said = plan_summary(golden)
    assert "axes 3.03 s; without the focus sweep of check_seated\n" in said
    steps = tuple(step for step in golden.steps if step.verb != "verify")
    assert "focus sweep" not in plan_summary(replace(golden, steps=steps))


def test_a_lone_part_is_told_of_the_ground_that_it_shades(golden: Plan) -> None:
    said = _note(replace(golden, steps=golden.steps[:1]))
    assert "note: 1 look may err by more" in said
    assert "(shade of bodies on what lies lower, the ground too, find_gear)" in said
