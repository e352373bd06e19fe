"""A look made in two, compiled and run on the simulated cell."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import microplan.executor.cli.main
from microplan.executor.devices.safety import Safety
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.emit import plan_bytes
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import write_folder
from microplan.planner.store.summary import plan_summary
from microplan.schemas.plan import Look, Plan, parse_plan
from microplan.schemas.plan.views import ViewChange
from tests.executor.bench import QUICK
from tests.planner.examples import (
    FEW,
    ONE_LOOK,
    change,
    copy_example,
    cut,
    known_lens,
    read,
)

SEEDS = range(8)
SIGMA_UM = 30.0  # of the gear's place


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the plan folder of a gear, then a post, seen by few large pixels.

    Four of them on a tooth take more zoom than the gear's place allows.
    """
    where = tmp_path_factory.mktemp("coarse")
    file = copy_example(where / "task")
    cut(file, "{id: find_gear, do: locate, target: gear, view_um: [0, 0]}", ONE_LOOK)
    change(file.with_name("workcell.yaml"), "pixels: [640, 480]", "pixels: [200, 150]")
    change(file, "sigma_xy_um: 10,", "sigma_xy_um: 2,")
    change(file, "theta: any, sigma_xy_um: 30", f"sigma_xy_um: {SIGMA_UM}")
    change(file, "max_image_error: 0.002", "max_image_error: 0.06")
    known_lens(file)
    report = Report()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("microplan.planner.plan.compiler.PRESETS", {"fast": FEW})
        files = compile_task(read(file), report, Options(preset="fast"))
    assert files is not None
    write_folder(plan_bytes(files), where / "plan")
    (note,) = (d for d in report.found if d.code == "MP405")
    assert "'find_gear'" in note.message
    assert not [d for d in report.found if d.severity == "infeasible"]
    return where / "plan"


@pytest.fixture(scope="module")
def plan(folder: Path) -> Plan:
    return parse_plan((folder / "plan.json").read_text(encoding="utf-8"))


def ran(folder: Path, out: Path, seed: int) -> tuple[dict[str, Any], list[Any]]:
    """Return summary and journal of a run that ended well."""
    words = [
        *QUICK,
        "--seed",
        str(seed),
        "--run-dir",
        str(out),
    ]
    assert microplan.executor.cli.main.main([str(folder), *words, "--no-frames"]) == 0
    lines = (out / "events.jsonl").read_text(encoding="utf-8").splitlines()
    return json.loads((out / "summary.json").read_text()), list(map(json.loads, lines))


def looks(plan: Plan) -> tuple[Look, Look, Look]:
    coarse, fine = plan.steps[0].looks
    (post,) = plan.steps[1].looks
    return coarse, fine, post


def changed(look: Look) -> ViewChange:
    assert look.verdict is not None
    assert look.verdict.change is not None
    return look.verdict.change


def test_the_plan_has_both_looks_and_what_leads_from_one_to_the_other(
    plan: Plan,
) -> None:
    assert plan.status == "feasible"
    coarse, fine, post = looks(plan)
    assert (coarse.id, fine.id) == ("find_gear.coarse", "find_gear")
    assert plan.steps[0].action.kind == "locate"
    assert plan.steps[0].action.look == fine.id
    assert coarse.coarse is post.coarse is None
    assert fine.coarse is not None
    assert (fine.coarse.look, fine.coarse.axes) == (coarse.id, "stage")
    assert fine.coarse.at_um == (0.0, 0.0)
    assert coarse.view.magnification < 19.2 <= fine.view.magnification
    assert fine.verdict is not None
    assert fine.verdict.zoom.least == pytest.approx(19.2)
    # it could not have seen the gear wherever it may lie: it needs 2 sigma to each side
    assert fine.view.field_um[1] < 100 + 4 * SIGMA_UM
    assert changed(fine).parcentric_sigma_um == 1.0  # the workcell's
    assert changed(fine).since == coarse.id
    assert "gear.teeth" in plan_summary(plan)


def after_probe(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return what happened after the axes were probed and had gone back."""
    kinds = [e["event"] for e in events]
    last = max(k for k, kind in enumerate(kinds) if kind in ("probe", "probe_turn"))
    back = next(k for k in range(last, len(kinds)) if kinds[k] == "moved")
    return events[back + 1 :]


def probed_s(events: list[dict[str, Any]]) -> float:
    """Return how long the probe took, with the look that is made again after it."""
    first = next(e["t_s"] for e in events if e["event"] == "seen")
    again = next(e["t_s"] for e in after_probe(events) if e["event"] == "seen")
    return float(again - first)


@pytest.mark.slow
def test_the_fine_look_finds_the_target_wherever_it_lies(
    folder: Path, plan: Plan, tmp_path: Path
) -> None:
    _, fine, _ = looks(plan)
    half_um = (fine.view.field_um[1] - 100) / 2  # room beside the gear in the field
    outside, errors = 0, []
    for seed in SEEDS:
        summary, events = ran(folder, tmp_path / str(seed), seed)
        assert summary["done"] or summary["code"] is None
        errors.append(summary["true_look_error_um"]["find_gear"])
        first = next(e["at"] for e in after_probe(events) if e["event"] == "seen")
        outside += max(abs(first["x_um"]), abs(first["y_um"])) > half_um
        # it starts in the middle of its view, to which a probe goes back
        there, back = [e["to"] for e in after_probe(events) if e["event"] == "move"][:2]
        assert (back["x_um"], back["y_um"]) == (-600.0, 0.0)
        assert there["x_um"] + 600 == pytest.approx(-first["x_um"], abs=1.0)
    assert outside  # the fine look alone would have missed some
    # an rms over both axes above 2 sigma sqrt(2) has a chance below 1e-7 in 8 runs
    rms_um = math.hypot(*errors) / math.sqrt(len(errors))
    assert rms_um < 2 * math.sqrt(2) * fine.sigma_xy_um


def test_looks_take_as_long_as_the_plan_says(
    folder: Path, plan: Plan, tmp_path: Path
) -> None:
    coarse, fine, post = looks(plan)
    summary, events = ran(folder, tmp_path / "run", 2)
    gear, seat = summary["steps"]
    # that a motion has settled is seen at the next reading
    late_s = Safety().poll_s * sum(e["event"] == "move" for e in after_probe(events))
    assert -1e-5 < seat["time_s"] - changed(post).total_s < late_s + 1e-5
    way = next(e["to"] for e in after_probe(events) if e["event"] == "move")
    moved_um = math.hypot(way["x_um"] + 600, way["y_um"])
    centring = [r for r in changed(fine).times if "centres" in r.what]
    assert len(centring) == 2  # there and back
    planned_s = changed(coarse).total_s + changed(fine).total_s
    # at 1000 um/s; the plan has the mean of where the gear may lie
    actual_s = planned_s + 2 * moved_um / 1000 - sum(r.time_s for r in centring)
    gear_s = gear["time_s"] - probed_s(events)  # no plan counts it
    assert -1e-5 < gear_s - actual_s < late_s + 1e-5
