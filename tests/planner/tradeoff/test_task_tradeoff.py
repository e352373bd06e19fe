"""A whole task compiled in several ways: which, what is told, what is compared."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from microplan.optics.lens.sensor import Sensor, expose, to_unit
from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS, parse_vary
from microplan.planner.tradeoff.task_axes import averaged, compile_methods
from microplan.planner.tradeoff.task_tradeoff import (
    choices,
    error_um,
    point_of,
    run_s,
    success_lower,
    with_fronts,
)
from microplan.planner.tradeoff.task_tradeoff_record import Spent, TradeoffPoint
from microplan.schemas.plan import Plan, parse_plan
from tests.planner.examples import EXAMPLE, FEW, change, copy_example, one_look, read

GOLDEN = Path(__file__).parents[2] / "golden" / "gear_on_shaft.fast.json"


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Return the example's plan."""
    return parse_plan(GOLDEN.read_text(encoding="utf-8"))


def test_each_way_differs_from_the_tasks_own_in_one_thing() -> None:
    task = read(EXAMPLE / "task.yaml")
    found = compile_methods(
        task, parse_vary("preset,trials=24:64,frames,zoom=6.9:13.8")
    )
    own = found[0]
    assert own.preset == task.optimise.prefer == "balanced"
    assert [way.varied for way in found[1:]] == [
        "preset fast", "preset accurate",  # its own is there already
        "trials 24",  # so are 64
        "frames 4", "frames 16",
        "zoom 6.9", "zoom 13.8",
    ]  # fmt: skip
    assert found[1].effort == PRESETS["fast"]
    assert found[3].effort == replace(PRESETS["balanced"], trials=24, random_trials=37)
    assert found[6].of(task).workcell.optics.magnification == (6.9, 6.9)
    assert found[0].of(task) == task


@pytest.mark.parametrize(
    "text",
    ["", "speed", "preset=", "preset,preset", "preset;zoom", "=1", "zoom=6.9,", ","],
)
def test_axes_that_do_not_exist_are_a_wrong_call(text: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        parse_vary(text)
    assert main(["tradeoff", "task.yaml", "--vary", text]) == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("preset=quick", "preset must be fast, balanced, accurate"),
        ("trials=0", "trials must be a whole number from 1"),
        ("trials=1.5", "trials must be a whole number"),
        ("trials=99999999", "to 1e+04"),
        ("frames=3", "a power of two"),
        ("frames=512", "to 256"),
        ("zoom=nan", "zoom must be a number"),
        ("zoom=1e400", "zoom must be a number"),
        ("zoom=100", "to 44.54"),
        ("zoom=" + ":".join(str(7 + k / 10) for k in range(70)), "71 points, at most"),
    ],
)
def test_values_that_cannot_be_are_said_before_anything_is_done(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    call = ["tradeoff", str(EXAMPLE / "task.yaml"), "--vary", text, "-o", str(out)]
    assert main(call) == 2
    heard = capsys.readouterr()
    assert says in heard.err
    assert "error[MP404]" in heard.err
    assert not out.exists()


def test_frames_of_a_camera_that_bends_or_cuts_off_are_not_summed() -> None:
    task = read(EXAMPLE / "task.yaml")
    camera = replace(task.workcell.camera, noise=((10.0, 25.0), (240.0, 2.0)))
    bent = replace(task, workcell=replace(task.workcell, camera=camera))
    with pytest.raises(ValueError, match="without response or noise_table"):
        compile_methods(bent, parse_vary("frames=4"))
    assert len(compile_methods(bent, parse_vary("frames"))) == 1
    assert len(compile_methods(task, parse_vary("frames"))) == 3


@pytest.mark.parametrize("frames", [2, 16])
def test_an_averaged_frame_is_the_mean_of_frames(frames: int) -> None:
    """Mean and variance of one frame of the averaged camera, and of drawn frames."""
    camera = read(EXAMPLE / "task.yaml").workcell.camera
    one, sums = (
        Sensor(full_well_e=c.full_well_e, read_noise_e=c.read_noise_e, bits=c.bits)
        for c in (camera, averaged(camera, frames))
    )
    light, rng = np.full((200, 200), 0.3), np.random.default_rng(1)
    drawn = [to_unit(expose(light, one, rng), one.bits) for _ in range(frames)]
    mean = np.mean(drawn, axis=0)
    at_once = to_unit(expose(light, sums, rng), sums.bits)
    # 40 000 pixels tell a variance to .7 %, a mean to 1 / 200 of a sigma
    assert at_once.std() == pytest.approx(mean.std(), rel=0.03)
    assert at_once.mean() == pytest.approx(mean.mean(), abs=0.03 * mean.std())
    assert averaged(camera, frames).rate_hz * frames == pytest.approx(camera.rate_hz)


def test_a_plan_is_told_by_its_budget_and_bounds(plan: Plan) -> None:
    insert = next(step for step in plan.steps if step.verb == "insert")
    squares = {row.term: row.sigma_um or 0.0 for row in insert.budget.rows}
    size = squares.pop("size of hole and shaft")
    assert size > 0  # it takes room, it moves nothing
    found = error_um(plan)
    assert found == pytest.approx(math.hypot(*squares.values()))
    looks = [look for step in plan.steps for look in step.looks]
    assert plan.success_bound is not None
    assert success_lower(plan) == plan.success_bound.success_low
    assert success_lower(replace(plan, success_bound=None)) is None
    # an alignment's approach and looks are its control's, the first one among them
    servos = [step.control for step in plan.steps if step.control is not None]
    once = [look for step in plan.steps if step.control is None for look in step.looks]
    changes = [look.verdict.change for look in once if look.verdict is not None]
    waits = [change.total_s for change in changes if change is not None]
    assert (len(servos), len(waits)) == (2, len(looks) - 2)
    # one that moves something before its look: that takes what no plan alone says
    (moved,) = [s for s in plan.steps if s.control is not None and s.moves]
    first = moved.looks[0].verdict
    assert first is not None
    assert first.change is not None
    assert moved.control is not None
    assert moved.control.expected_cycles == 1.0
    servos.remove(moved.control)
    waits.append(first.change.total_s)
    servoing = sum(servo.approach_s + servo.expected_s for servo in servos)
    # the plan keeps six digits of each
    assert run_s(plan) == pytest.approx(sum(waits) + servoing, abs=1e-4)


def test_only_choices_are_compared(plan: Plan) -> None:
    assert choices(plan, plan) == ()
    steps = list(plan.steps)
    first = steps[0].looks[0]
    zoomed = replace(first, view=replace(first.view, magnification=13.8))
    chain = replace(first.measure, chain=first.measure.chain[:1])
    steps[0] = replace(steps[0], looks=(replace(zoomed, measure=chain),))
    noisier = replace(steps[1].looks[0].measure, sigma_xy_um=9.0)
    steps[1] = replace(steps[1], looks=(replace(steps[1].looks[0], measure=noisier),))
    found = choices(plan, replace(plan, steps=tuple(steps)))
    assert [text.partition(":")[0] for text in found] == [
        "find_gear magnification", "find_gear chain",
    ]  # fmt: skip
    fewer = choices(plan, replace(plan, steps=plan.steps[:-1]))
    assert fewer  # a step that is not reached


def test_a_task_that_cannot_be_compiled_is_a_point_with_its_reason() -> None:
    report = Report()
    (own, *_) = compile_methods(read(EXAMPLE / "task.yaml"), ())
    report.error("MP303", read(EXAMPLE / "task.yaml").where["goal"], "it touches")
    point = point_of(own, None, report, None)
    assert (point.status, point.reason) == ("error", "MP303 it touches")
    assert point.error_um is None
    assert point.choices is None


def a_point(error: float | None, run: float | None) -> TradeoffPoint:
    return TradeoffPoint(
        varied="trials 1", preset="fast", trials=1, frames=1, zoom=None,
        status="feasible", reason="", error_um=error, success_probability=1.0,
        success_lower=1.0, run_s=run, choices=(), on_front=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("pairs", "front"),
    [
        ([(1.0, 1.0), (2.0, 0.5), (3.0, 0.7), (0.5, 2.0)], [0, 1, 3]),
        ([(1.0, 1.0), (1.0, 1.0)], [0]),
        ([(None, None), (1.0, 1.0)], [1]),
        ([(None, None)], []),
    ],
)
def test_the_front_holds_what_no_other_is_below_in_both(
    pairs: Sequence[tuple[float | None, float | None]], front: list[int]
) -> None:
    points = [a_point(error, run) for run, error in pairs]
    spent = [
        Spent(varied="", cpu_s=run or 0.0, wall_s=0.0, on_front=False)
        for run, _ in pairs
    ]
    found, times = with_fronts(points, spent)
    assert [k for k, point in enumerate(found) if point.on_front] == front
    assert [k for k, took in enumerate(times) if took.on_front] == front


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder and the table of one look, compiled in two ways."""
    base = tmp_path_factory.mktemp("tradeoff")
    task = copy_example(base / "example")
    one_look(task)
    change(task, "prefer: balanced", "prefer: fast")
    out = base / "out"
    call = ["tradeoff", str(task), "--vary", "trials=8", "-o", str(out)]
    few = {**PRESETS, "fast": replace(FEW, trials=12, random_trials=24)}
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as said,
    ):
        patch.setattr("microplan.planner.tradeoff.task_axes.PRESETS", few)
        assert main(call) == 0
    return out, said.getvalue()


def test_table_csv_json_and_picture_agree(written: tuple[Path, str]) -> None:
    folder, table = written
    data: dict[str, Any] = json.loads((folder / "task.json").read_text("utf-8"))
    rows = list(csv.DictReader((folder / "task.csv").read_text("utf-8").splitlines()))
    names = ["as the task says", "trials 8"]
    assert [row["varied"] for row in rows] == names
    assert [point["varied"] for point in data["points"]] == names
    for row, point in zip(rows, data["points"], strict=True):
        assert float(row["error_um"]) == point["error_um"] > 0
        assert point["status"] == "feasible"
        assert point["success_lower"] < point["success_probability"] == 1.0
        assert f"{point['error_um']:.3f}" in table
    assert data["points"][1]["success_lower"] < data["points"][0]["success_lower"]
    assert (folder / "task.png").read_bytes().startswith(b"\x89PNG")


def test_what_depends_on_the_machine_stands_apart(written: tuple[Path, str]) -> None:
    folder, _ = written
    times = json.loads((folder / "task-times.json").read_text("utf-8"))
    assert all(point["cpu_s"] > 0 for point in times["points"])
    for name in ("task.json", "task.csv"):
        assert "cpu" not in (folder / name).read_text("utf-8")
