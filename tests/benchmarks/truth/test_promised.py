"""Promises of a plan's looks, by the numbers of its file."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.truth.promised import UNSEEN, angles_before, promised
from microplan.executor.record.plan_file import read_plan
from microplan.schemas.plan import Plan

SURFACES = ("side walls", "finish of faces")  # trials draw them, or pairs charge them

GOLDEN = Path(__file__).parents[2] / "golden" / "gear_on_shaft.fast.json"


@pytest.fixture(scope="module")
def plan() -> Plan:
    return read_plan(GOLDEN).plan


@pytest.fixture(scope="module")
def raw() -> dict[str, Any]:
    """Return the looks of the file by their ids."""
    content = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return {look["id"]: look for step in content["steps"] for look in step["looks"]}


def test_each_axis_is_promised_what_the_cell_can_show(
    plan: Plan, raw: dict[str, Any]
) -> None:
    for look in (look for step in plan.steps for look in step.looks):
        found, own = promised(look), raw[look.id]["measure"]
        rows = [e for e in raw[look.id]["effects"] if e["cost"]]
        # one picture shows layers and shade: its cost stands in both rows
        cost = own["model_cost"]
        drawn = SURFACES if cost is not None and any(cost["drawn_um"]) else ()
        shown = {
            e["cost"]["by"]: e["cost"]
            for e in rows
            if e["effect"] not in (*UNSEEN, *drawn)
        }
        lost = [e["cost"]["sigma_um"] for e in rows if e["effect"] in UNSEEN]
        for k in range(2):
            added = 0.0 if cost is None else cost["sigma_um"][k]
            more = max(added - sum(each[k] for each in lost), 0.0)
            random = own["repeatability"]["sigma_um"][k]
            less = 0.0 if cost is None else cost["spared_um"][k]
            less = min(less, math.sqrt(3) / 2 * random)
            assert found.sigma_um[k] ** 2 == pytest.approx(
                random**2 + more**2 - less**2, rel=1e-4
            )  # six digits in the file
            half = sum(each["half_width_um"][k] for each in shown.values())
            half += own["repeatability"]["half_width_um"][k]
            assert found.half_width_um[k] == pytest.approx(half, rel=1e-4)
            unseen = [e["cost"]["bias_um"][k] for e in rows if e["effect"] in UNSEEN]
            assert found.unseen_bias_um[k] == pytest.approx(sum(unseen))
        assert max(found.sigma_um) <= look.sigma_xy_um * (1 + 1e-5)


def test_angles_are_known_after_the_look_that_measures_them(plan: Plan) -> None:
    known = angles_before(plan)
    assert set(known) == {
        "bring_between",
        "gear_in_fingers",
        "over_shaft",
        "check_seated.target",
    }
    looks = {look.id: look for step in plan.steps for look in step.looks}
    assert set(known.values()) == {looks["find_gear"].sigma_theta_rad}


def test_a_plan_without_random_trials_promises_nothing(plan: Plan) -> None:
    look = plan.steps[0].looks[0]
    old = replace(look, measure=replace(look.measure, repeatability=None))
    with pytest.raises(ValueError, match="no random trials"):
        promised(old)
    assert np.all(np.array(promised(look).sigma_um) > 0)
