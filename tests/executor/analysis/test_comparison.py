"""Runs against the plan: its right predictions stand, wrong ones are refuted."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from microplan.executor.analysis.comparison import compare, predicted_s
from microplan.executor.analysis.comparison_report import comparison_text
from microplan.executor.analysis.run_summaries import RunFolderSummary
from microplan.executor.cli.main import main
from microplan.executor.record.plan_file import read_plan
from microplan.schemas.plan import AlignAction, Plan, parse_plan
from tests.executor.bench import Folder, assembly, world

STEP = "bring_between"
RUNS = 8
ROUNDS = 300


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan folder."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker = Folder(folder)
    maker.write(assembly(maker), world())
    return folder


@pytest.fixture
def plan(built: Path) -> Plan:
    """Return a plan of one alignment that predicts something."""
    found = parse_plan((built / "plan.json").read_text("utf-8"))
    step = next(s for s in found.steps if isinstance(s.action, AlignAction))
    assert step.control is not None
    control = replace(
        step.control,
        expected_cycles=2.5,
        expected_s=0.5,
        approach_s=0.3,
        method="servo",
    )
    steps = (replace(step, id=STEP, control=control),)
    return replace(found, steps=steps, success_probability=0.95)


def summary(plan: Plan, rng: np.random.Generator, **wrong: float) -> dict[str, Any]:
    """Return a run's summary drawn from the plan's predictions, or others."""
    step = plan.steps[0]
    control, sigma_um = step.control, step.looks[0].sigma_xy_um
    assert control is not None
    looks = int(rng.geometric(1 / (control.expected_cycles * wrong.get("cycles", 1.0))))
    time_s = predicted_s(control, looks) * wrong.get("time", 1.0)
    time_s += 0.02 * rng.standard_normal()
    done = bool(rng.random() < plan.success_probability * wrong.get("success", 1.0))
    error_um = math.hypot(
        *(sigma_um * wrong.get("error", 1.0) * rng.standard_normal(2))
    )
    row = {
        "id": STEP, "code": None, "cycles": looks, "time_s": time_s, "error_um": 0.5,
        "limit_um": 1.0, "spread_um": 0.1, "expected_sigma_um": sigma_um,
        "height_um": None,
    }  # fmt: skip
    return {
        "code": None if done else "MP851", "done": done, "steps": [row],
        "true_look_error_um": {STEP: error_um},
    }  # fmt: skip


def runs_of(
    plan: Plan, seed: int, count: int = RUNS, **wrong: float
) -> tuple[RunFolderSummary, ...]:
    rng = np.random.default_rng(seed)
    return tuple(
        RunFolderSummary(folder=Path(str(k)), data=summary(plan, rng, **wrong))
        for k in range(count)
    )


def test_right_predictions_are_rarely_refuted(plan: Plan) -> None:
    alarms = sum(bool(compare(plan, runs_of(plan, k)).refuted) for k in range(ROUNDS))
    # .05 of the rounds, and three standard deviations of their binomial
    most = 0.05 * ROUNDS + 3 * math.sqrt(0.05 * 0.95 * ROUNDS)
    assert alarms <= most


@pytest.mark.parametrize(
    ("name", "factor", "check"),
    [("cycles", 2.5, "looks"), ("time", 1.4, "time"), ("time", 0.7, "time"),
     ("success", 0.5, "success"), ("error", 2.5, "true error")],
)  # fmt: skip
def test_a_wrong_prediction_is_refuted(
    plan: Plan, name: str, factor: float, check: str
) -> None:
    found = compare(plan, runs_of(plan, 1, 30, **{name: factor}))
    assert [c.name for c in found.refuted] == [check]


def test_a_time_off_by_less_than_a_tenth_stands(plan: Plan) -> None:
    assert compare(plan, runs_of(plan, 3, 30, time=1.08)).refuted == ()


def test_the_figures_are_those_of_numpy(plan: Plan) -> None:
    runs = runs_of(plan, 5, 20)
    figures = {f.name: f for f in compare(plan, runs).figures}
    times = [r.data["steps"][0]["time_s"] for r in runs]
    assert figures["time"].runs.mean == pytest.approx(np.mean(times))
    assert figures["time"].sd == pytest.approx(np.std(times, ddof=1))
    assert figures["time"].p95 == pytest.approx(sorted(times)[18])
    assert figures["time"].predicted == pytest.approx(0.8)
    assert figures["looks"].predicted == pytest.approx(2.5)
    assert figures["error"].limit == pytest.approx(1.0)


def test_a_run_the_operator_stopped_says_nothing_of_the_plan(plan: Plan) -> None:
    runs = runs_of(plan, 2, 3)
    stopped = RunFolderSummary(
        folder=Path("x"), data={**runs[0].data, "code": "MP860", "done": False}
    )
    found = compare(plan, (*runs, stopped))
    assert found.counted == 3


@pytest.mark.parametrize("key", ["faults", "executors"])
def test_runs_with_faults_and_resumed_ones_are_left_apart(plan: Plan, key: str) -> None:
    runs = runs_of(plan, 8, 4)
    data = {**summary(plan, np.random.default_rng(9)), "done": False, "code": "MP845"}
    data[key] = ["axis_short"] if key == "faults" else 2
    odd = RunFolderSummary(folder=Path("odd"), data=data)
    found = compare(plan, [*runs, odd])
    assert (found.runs, found.apart) == (tuple(runs), (odd,))
    assert (found.done, found.counted) == (4, 4)
    assert f"left apart: odd, {odd.apart}" in comparison_text(plan, found)


def written(plan_file: Path, folder: Path, data: dict[str, Any]) -> Path:
    folder.mkdir()
    sha = read_plan(plan_file).sha256
    text = json.dumps({"plan_sha256": sha, **data})
    (folder / "summary.json").write_text(text, "utf-8")
    return folder


def test_the_command_joins_runs_and_says_what_is_refuted(
    built: Path, plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = built / "plan.json"
    rng = np.random.default_rng(0)
    names = [
        str(written(file, tmp_path / f"run{k}", summary(plan, rng))) for k in range(4)
    ]
    assert main([str(built), "--mode", "compare", "--runs", *names]) in (0, 1)
    out = capsys.readouterr().out
    assert "runs: 4, done: 4 of 4" in out
    assert f"{STEP}  looks" in out
    call = [str(built), "--mode", "compare", "--runs", *names, "--format", "json"]
    main(call)
    said = json.loads(capsys.readouterr().out)
    assert said["counted"] == 4
    assert {c["name"] for c in said["checks"]} >= {"success", "looks", "time"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"code": None, "done": True}, "is no summary of a run"),
        ({"code": None, "done": True, "steps": [], "true_look_error_um": {},
          "plan_sha256": "0"}, "is a run of another plan"),
        ({"code": None, "done": True, "true_look_error_um": {},
          "steps": [{"id": "a", "code": None, "time_s": "long"}]}, "is no summary"),
        ({"code": None, "done": True, "true_look_error_um": {"a": math.nan},
          "steps": []}, "is no summary"),
        ({"code": None, "done": True, "true_look_error_um": {},
          "steps": [{"id": "a", "code": None, "time_s": 10**400}]}, "is no summary"),
    ],
)  # fmt: skip
def test_a_folder_that_is_no_run_of_the_plan_is_refused(
    built: Path,
    tmp_path: Path,
    data: dict[str, Any],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = written(built / "plan.json", tmp_path / "run", data)
    assert main([str(built), "--mode", "compare", "--runs", str(run)]) == 2
    said = capsys.readouterr().err
    assert "error[MP879]" in said
    assert words in said


def test_the_same_run_twice_is_refused(
    built: Path, plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = {**summary(plan, np.random.default_rng(1)), "station": "sim", "seed": 3}
    first = str(written(built / "plan.json", tmp_path / "a", data))
    second = str(written(built / "plan.json", tmp_path / "b", data))
    for names in ((first, first), (first, second)):
        assert main([str(built), "--mode", "compare", "--runs", *names]) == 2
        assert "are the same run" in capsys.readouterr().err
    odd = written(built / "plan.json", tmp_path / "odd", {**data, "seed": {"a": []}})
    assert main([str(built), "--mode", "compare", "--runs", first, str(odd)]) in (0, 1)
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "summary.json").write_text("[" * 100_000, "utf-8")
    assert main([str(built), "--mode", "compare", "--runs", str(tmp_path / "c")]) == 2
