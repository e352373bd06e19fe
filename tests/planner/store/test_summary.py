"""What is said of a plan below its steps."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.optics.ledger import CONTRAST
from microplan.planner.store.summary import left_out, plan_summary
from microplan.schemas.plan import EffectCost, Look, Plan, parse_plan
from tests.planner.examples import ROOT


@pytest.fixture(scope="module")
def golden() -> Plan:
    """Return the golden plan of the gear-on-shaft example."""
    file = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
    return parse_plan(file.read_text(encoding="utf-8"))


def test_what_pictures_err_by_beyond_the_limit_is_paid_in_um(golden: Plan) -> None:
    """No note says that it may matter: every such row has a number."""
    assert "note:" not in plan_summary(golden)
    looks = [look for step in golden.steps for look in step.looks]
    assert len(looks) == 8
    for look in looks:
        over = [
            row for row in look.effects
            if row.unit == CONTRAST and row.limit is not None
            and (row.predicted_error is None or row.predicted_error > row.limit)
        ]  # fmt: skip
        assert over
        assert all(row.cost is not None and row.cost.pairs >= 12 for row in over)
        cost = look.model_cost
        assert cost is not None
        paid = _paid(look)
        for axis in (0, 1):
            bias = sum(found.bias_um[axis] for found in paid)
            assert cost.bias_um[axis] == pytest.approx(bias, abs=1e-5)
        own = look.measure.model_cost
        assert own is not None
        assert look.sigma_xy_um >= max(own.sigma_um)


def _paid(look: Look) -> list[EffectCost]:
    """Return what a look's rows cost; those that are paid together once."""
    found = [row.cost for row in look.effects if row.cost is not None]
    return list({cost.by: cost for cost in found}.values())


@pytest.mark.parametrize(
    ("chance", "told"),
    [(0.99996, "> 0.9999"), (1.0, "> 0.9999"), (0.99994, "0.9999"), (0.5, "0.5000")],
)
def test_no_chance_is_told_as_certain(golden: Plan, chance: float, told: str) -> None:
    plain = replace(golden, success_probability=chance, success_bound=None)
    said = plan_summary(plain)
    assert f"feasible, P(success) {told}, goal 0.95 (simulated)" in said
    assert "focus -16..+16 um (12 draws); P > 0.9999\n" in said  # see_fingers: .999999


@pytest.mark.parametrize(("goal", "most"), [(0.95, True), (0.8, False), (None, False)])
def test_the_lower_bound_stands_beside_the_probability(
    golden: Plan, goal: float | None, most: bool
) -> None:
    """With what its trials can show, where that is below the goal."""
    bound = golden.success_bound
    assert bound is not None
    said = plan_summary(replace(golden, success_goal=goal)).splitlines()
    low = f"at least {bound.success_low:.4f} at 0.95 confidence by 64 random trials"
    assert low in said[0]
    assert (f"which show {bound.reachable:.4f} at most" in said[0]) == most
    assert said[1] == "not in P(success): grasp (may slip)"
    assert bound.left_out == left_out(golden.steps) == ("grasp (may slip)",)
    assert bound.success_low <= golden.success_probability


def test_a_focus_sweep_that_is_not_in_the_time_is_named(golden: Plan) -> None:
    said = plan_summary(golden)
    assert said.endswith("axes 2.86 s; without the focus sweep of check_seated")
    steps = tuple(step for step in golden.steps if step.verb != "verify")
    assert "focus sweep" not in plan_summary(replace(golden, steps=steps))
