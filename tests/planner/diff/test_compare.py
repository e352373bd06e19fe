"""Differences of plans are told by what they are about, and nothing else is told."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

from microplan.planner.diff.changes import PlanChange, is_number
from microplan.planner.diff.compare import compare_plans
from microplan.planner.diff.tolerances import parse_rule, unit_of
from microplan.schemas.plan import Plan, parse_plan
from tests.planner.examples import ROOT
from tests.project.test_reference import rows

GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
TEXT = GOLDEN.read_text(encoding="utf-8")
Data = dict[str, Any]


@cache
def golden() -> Plan:
    """Return the golden plan."""
    return parse_plan(TEXT)


def plan(edit: Callable[[Data], object]) -> Plan:
    """Return the golden plan, edited."""
    data = json.loads(TEXT)
    edit(data)
    return parse_plan(json.dumps(data))


def step(data: Data, name: str) -> Data:
    found: Data = next(s for s in data["steps"] if s["id"] == name)
    return found


def look(data: Data, name: str) -> Data:
    found: Data = step(data, name)["looks"][0]
    return found


def effect(data: Data, name: str, called: str) -> Data:
    found: Data = next(e for e in step(data, name)["effects"] if e["effect"] == called)
    return found


def find(data: Data) -> Data:
    found: Data = look(data, "find_gear")["measure"]
    return found


def changes(edit: Callable[[Data], object], *rules: str) -> list[PlanChange]:
    """Return what an edit of the golden plan changes."""
    return list(compare_plans(golden(), plan(edit), [parse_rule(r) for r in rules]))


def told(edit: Callable[[Data], object], *rules: str) -> list[tuple[str, str, str]]:
    return [(c.kind, c.where, c.says) for c in changes(edit, *rules)]


def test_a_plan_means_the_same_as_itself() -> None:
    assert told(lambda data: None) == []


def test_keys_pixels_and_versions_mean_nothing() -> None:
    def edit(data: Data) -> None:
        data["provenance"]["microplan"] = "9.9"
        for each in data["steps"]:
            each["key"] = "f" * 64
            for found in each["looks"]:
                found["scene"]["image_sha256"] = "0" * 64
                found["measure"]["chain"][0]["arrays"] = "artifacts/elsewhere.npz"

    assert told(edit) == []


def test_steps_are_matched_by_id() -> None:
    """A step put between others changes nothing of those after it."""

    def edit(data: Data) -> None:
        new = json.loads(json.dumps(step(data, "retract")))
        data["steps"].insert(3, {**new, "id": "pause"})

    assert told(edit) == [("steps", "steps/pause", "added")]
    found = compare_plans(plan(edit), golden())
    assert [(c.kind, c.where, c.says) for c in found] == [
        ("steps", "steps/pause", "removed")
    ]


def test_order_counts_once() -> None:
    def edit(data: Data) -> None:
        steps = data["steps"]
        steps[0], steps[1] = steps[1], steps[0]

    ((kind, where, says),) = told(edit)
    assert (kind, where) == ("steps", "steps")
    assert says.startswith("order find_gear > see_fingers")
    assert "became see_fingers > find_gear" in says


def test_effects_are_matched_by_name() -> None:
    def edit(data: Data) -> None:
        look(data, "find_gear")["effects"].reverse()

    assert told(edit) == []


def test_a_chain_is_one_choice() -> None:
    def edit(data: Data) -> None:
        look(data, "find_gear")["measure"]["chain"].pop()

    where = "steps/find_gear/looks/find_gear/measure/chain"
    assert told(edit) == [("choice", where, "otsu > tooth_notch became otsu")]


def test_what_a_routine_learnt_is_no_choice() -> None:
    def edit(data: Data) -> None:
        found = look(data, "find_gear")["measure"]
        found["chain"][0]["parameters"]["area_px"] *= 1.5
        found["fallback"][0]["parameters"]["more"] = 1.0

    where = "steps/find_gear/looks/find_gear/measure"
    assert [(kind, path) for kind, path, _ in told(edit)] == [
        ("learnt", f"{where}/chain/otsu/parameters/area_px"),
        ("learnt", f"{where}/fallback/contour_match/parameters/more"),
    ]


def test_a_moved_feature_is_told_in_um_and_sigmas() -> None:
    def edit(data: Data) -> None:
        place = next(f for f in data["features"] if f["name"] == "gear.bore")
        place["x_um"] += 0.3
        place["y_um"] -= 0.4

    sigma = look(json.loads(TEXT), "over_shaft")["measure"]["sigma_xy_um"]
    ((kind, where, says),) = told(edit)
    assert (kind, where) == ("feature", "features/gear.bore/place_um")
    assert says.startswith("moved 0.5 um, from (0, 0) to (0.3, -0.4)")
    assert says.endswith(f"{0.5 / sigma:.3g} sigma of the look at it")
    assert told(edit, "features/*/place_um=0.6") == []


def test_features_come_and_go() -> None:
    def edit(data: Data) -> None:
        data["features"] = [f for f in data["features"] if f["name"] != "gear.bore"]

    assert told(edit) == [("feature", "features/gear.bore", "removed")]


Edit = tuple[str, Callable[[Data], object], str, str]
EDITS: tuple[Edit, ...] = (
    ("feasibility", lambda d: d.update(status="infeasible"), "status", "worse"),
    ("feasibility", lambda d: d.update(success_probability=0.5),
     "success_probability", "worse"),
    ("inputs", lambda d: d["provenance"].update(seed=1), "provenance/seed", ""),
    ("choice", lambda d: look(d, "find_gear")["view"].update(magnification=9.0),
     "steps/find_gear/looks/find_gear/view/magnification", ""),
    ("choice", lambda d: step(d, "over_shaft")["control"].update(gain=0.7),
     "steps/over_shaft/control/gain", ""),
    ("prediction", lambda d: look(d, "find_gear")["measure"].update(sigma_xy_um=0.01),
     "steps/find_gear/looks/find_gear/measure/sigma_xy_um", "better"),
    ("prediction", lambda d: look(d, "find_gear")["measure"].update(sigma_xy_um=1.0),
     "steps/find_gear/looks/find_gear/measure/sigma_xy_um", "worse"),
    ("evidence",
     lambda d: look(d, "find_gear")["evidence"]["chosen"].update(trials=7),
     "steps/find_gear/looks/find_gear/evidence/chosen/trials", ""),
    ("effects",
     lambda d: look(d, "find_gear")["effects"][0].update(level="geometric"),
     "steps/find_gear/looks/find_gear/effects/defocus law/level", ""),
    ("choice", lambda d: step(d, "bring_between")["control"].update(tolerance_xy_um=2),
     "steps/bring_between/control/tolerance_xy_um", ""),
    ("motion", lambda d: step(d, "lift")["moves"][0].update(z_um=-250.0),
     "steps/lift/moves/0/z_um", ""),
    ("motion", lambda d: d["beliefs"][0].update(sigma_xy_um=20.0),
     "beliefs/gear/sigma_xy_um", "better"),
    ("effects", lambda d: effect(d, "insert", "wedging").update(predicted_error=0.3),
     "steps/insert/effects/wedging/predicted_error", "worse"),
    ("effects", lambda d: effect(d, "insert", "taper").update(predicted_error=0.1),
     "steps/insert/effects/taper/predicted_error", "better"),
    ("effects", lambda d: effect(d, "release", "weight").update(predicted_error=1.0),
     "steps/release/effects/weight/predicted_error", ""),
    ("prediction", lambda d: step(d, "insert")["fit"]["capture_um"].__setitem__(0, 2),
     "steps/insert/fit/capture_um/0", "worse"),
    ("prediction", lambda d: step(d, "insert")["fit"].update(wedging_rad=0.2),
     "steps/insert/fit/wedging_rad", "worse"),
    ("prediction", lambda d: find(d)["usable_focus_um"].__setitem__(0, -12),
     "steps/find_gear/looks/find_gear/measure/usable_focus_um/0", "better"),
    ("prediction", lambda d: find(d)["usable_focus_um"].__setitem__(1, 8),
     "steps/find_gear/looks/find_gear/measure/usable_focus_um/1", "worse"),
    ("prediction", lambda d: find(d)["fallback_bias_um"].__setitem__(0, -9.0),
     "steps/find_gear/looks/find_gear/measure/fallback_bias_um/0", "worse"),
    ("feasibility", lambda d: d.update(success_goal=0.99), "success_goal", ""),
)  # fmt: skip


@pytest.mark.parametrize(("kind", "edit", "where", "trend"), EDITS)
def test_a_change_is_told_where_it_is_and_what_it_is_about(
    kind: str, edit: Callable[[Data], object], where: str, trend: str
) -> None:
    (found,) = changes(edit)
    assert (found.kind, found.where, found.trend) == (kind, where, trend)
    assert told(edit, f"{where}=ignore") == []


UNITS: tuple[tuple[Callable[[Data], object], str], ...] = (
    (lambda d: d["requirements"]["travel"]["stage.theta_rad"].__setitem__(1, 0.5),
     "0 rad became 0.5 rad"),
    (lambda d: d["requirements"]["repeatability_um"].update(stage=2.0),
     "1 um became 2 um (+100 %)"),
    (lambda d: look(d, "find_gear")["view"].update(um_per_px=2.17392),
     "1.08696 um/px became 2.17392 um/px (+100 %)"),
    (lambda d: step(d, "insert")["fit"]["clearance_um"].__setitem__(0, -1.0),
     "4.6 um became -1 um"),
    (lambda d: look(d, "find_gear")["evidence"]["chosen"].update(trials=48),
     "24 became 48 (+100 %)"),
    (lambda d: step(d, "grasp")["grasp"]["force_un"].__setitem__(0, 25.6698),
     "12.8349 uN became 25.6698 uN (+100 %)"),
    (lambda d: d["provenance"].update(max_image_error=0.004),
     "0.002 unit contrast became 0.004 unit contrast (+100 %)"),
)  # fmt: skip


@pytest.mark.parametrize(("edit", "says"), UNITS)
def test_a_number_is_told_with_its_unit(
    edit: Callable[[Data], object], says: str
) -> None:
    (found,) = changes(edit)
    assert found.says == says
    assert found.unit in says
    assert bool(found.unit) == (" became 48" not in says)


def test_every_length_angle_time_and_force_of_a_plan_has_a_unit() -> None:
    """Only what has no dimension may be told without one."""
    bare: set[str] = set()

    def visit(data: Any, path: tuple[str, ...]) -> None:
        items = data.items() if isinstance(data, dict) else enumerate(data)
        for key, value in items:
            if isinstance(value, dict | list):
                visit(value, (*path, str(key)))
            elif is_number(value) and not unit_of((*path, str(key))):
                bare.add("/".join([p for p in (*path, str(key)) if not p.isdigit()]))

    visit(json.loads(TEXT), ())
    units = ("um", "rad", "_px", "_s", "_un", "_deg", "_nm", "_mm", "_e")
    assert [name for name in sorted(bare) if name.endswith(units)] == []


def test_units_are_those_of_the_reference() -> None:
    """Which has them from a table of its own."""
    told = [row for row in rows("plan") if "number" in row["type"]]
    units = {row["key"].strip("`"): row.get("unit", "1") for row in told}
    known = {key: u.replace("^", "") for key, u in units.items() if u != "1"}
    assert len(known) > 100
    assert {key: unit_of((key,)) for key in known} == known


def test_a_mean_is_compared_within_what_trials_repeat_to() -> None:
    def by(factor: float) -> Callable[[Data], None]:
        def edit(data: Data) -> None:
            look(data, "find_gear")["measure"]["sigma_xy_um"] *= factor

        return edit

    assert told(by(1.15)) == []
    assert len(told(by(1.3))) == 1
    assert told(by(1.3), "measure/sigma_xy_um=50%") == []
    assert len(told(by(1.15), "sigma_xy_um=1%")) == 1


@pytest.mark.parametrize("name", ["arrays", "reason", "region_a", "success", "travel"])
def test_a_step_called_as_a_key_is_compared_as_any_other(name: str) -> None:
    def called(sigma_um: float) -> Plan:
        def edit(data: Data) -> None:
            look(data, "find_gear")["measure"]["sigma_xy_um"] = sigma_um
            step(data, "find_gear")["id"] = name
            look(data, name)["id"] = name

        return plan(edit)

    (found,) = compare_plans(called(0.1), called(0.2))
    assert found.where == f"steps/{name}/looks/{name}/measure/sigma_xy_um"
    assert (found.kind, found.trend) == ("prediction", "worse")


def test_a_drawing_of_a_part_called_arrays_is_compared() -> None:
    def edit(digest: str) -> Callable[[Data], None]:
        drawn = {"drawings_sha256": {"arrays": digest}}
        return lambda data: data["provenance"].update(drawn)

    (found,) = compare_plans(plan(edit("1")), plan(edit("2")))
    assert found.kind == "inputs"
