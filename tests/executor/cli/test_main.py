"""Whole runs on the simulated cell, through the command."""

from __future__ import annotations

import json
import os
import shutil
import signal
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main
from microplan.executor.cli.select_station import find_site
from microplan.executor.simulated.cameras.quick_pictures import QuickPictures
from microplan.executor.simulated.cameras.solid_pictures import SolidPictures
from microplan.schemas.plan import dump_plan, parse_plan
from tests.executor.bench import QUICK
from tests.executor.kept import PLAN, SAID
from tests.executor.pictures import each_state_once

STEPS = 12
STATION = Path(__file__).parents[3] / "examples" / "stations" / "simulated.toml"


@pytest.fixture(scope="module")
def built(example_run: Path) -> Path:
    """Return a plan folder of the whole job; the gear lies near its place."""
    return example_run.with_name(PLAN)


def run(plan: Path, folder: Path, *options: str) -> int:
    words = [*QUICK, "--run-dir", str(folder)]
    return main([str(plan), *words, *options])


def events(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "events.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(
        (folder / "summary.json").read_text(encoding="utf-8")
    )
    return found


def edited(plan: Path, tmp_path: Path, old: str, new: str) -> Path:
    """Return a copy of a plan folder with one thing in plan.json changed."""
    copy = Path(shutil.copytree(plan, tmp_path / "edited.plan"))
    text = (copy / "plan.json").read_text(encoding="utf-8")
    assert old in text
    (copy / "plan.json").write_text(text.replace(old, new), encoding="utf-8")
    return copy


@pytest.fixture(scope="module")
def ran(example_run: Path) -> tuple[Path, str]:
    """Return the run folder of one good run, frames kept, and what it printed."""
    return example_run, example_run.with_name(SAID).read_text(encoding="utf-8")


def test_the_gear_ends_on_the_post(ran: tuple[Path, str]) -> None:
    folder, out = ran
    found = summary(folder)
    assert found["done"]
    assert found["code"] is None
    assert found["cell_verdict"]["success"]
    assert [s["code"] for s in found["steps"]] == [None] * STEPS
    assert "gear-on-shaft: done" in out
    assert "seated, offset" in out


def test_the_run_folder_holds_log_frames_and_summary(ran: tuple[Path, str]) -> None:
    folder, _ = ran
    log = events(folder)
    assert [e["seq"] for e in log] == list(range(1, len(log) + 1))
    assert log[0]["devices"]["stage"] == "simulated stage sim-stage"
    times = [e["t_s"] for e in log]
    assert times == sorted(times)
    for before, after in (("begin", "done"), ("move", "moved"), ("jaws", "jaws_moved")):
        count = sum(e["event"] == before for e in log)
        assert count == sum(e["event"] == after for e in log) > 0
    frames = sorted(p.name for p in (folder / "frames").iterdir())
    assert frames[0] == "01_find_gear_001.png"
    index = [
        json.loads(line)
        for line in (folder / "frames" / "index.jsonl").read_text("utf-8").splitlines()
    ]
    assert [Path(line["file"]).name for line in index] == frames[:-1]
    assert frames[-1] == "index.jsonl"
    assert {line["step"] for line in index} == {e["step"] for e in log if e["step"]}
    first = index[0]
    assert first["look"] == "find_gear"
    assert first["stage"]["x_um"] == pytest.approx(-600.0)
    assert first["magnification"] == pytest.approx(6.9)
    grabs = [e for e in log if e["event"] == "grab"]
    assert [e["look"] for e in grabs] == [line["look"] for line in index]
    assert sum(e["event"] == "light" for e in log) > 0
    assert "check_seated" in (folder / "summary.txt").read_text(encoding="utf-8")


@pytest.mark.usefixtures("one_render_a_state")
def test_the_run_folder_holds_plan_and_station_file_as_they_were_read(
    built: Path, ran: tuple[Path, str], tmp_path: Path
) -> None:
    plan = (built / "plan.json").read_bytes()
    assert (ran[0] / "plan.json").read_bytes() == plan
    assert not (ran[0] / "station.toml").exists()
    file, folder = tmp_path / "here.toml", tmp_path / "run"
    file.write_bytes(STATION.read_bytes().replace(b"\n", b"\r\n"))
    main([str(built), "--station", str(file), "--run-dir", str(folder), "--no-frames"])
    assert (folder / "station.toml").read_bytes() == file.read_bytes()


def test_the_same_seed_gives_the_same_bytes(
    built: Path, ran: tuple[Path, str], tmp_path: Path
) -> None:
    logs = []
    for name, once in (("a", False), ("b", True)):
        with each_state_once() if once else nullcontext():  # other tests have 0, too
            assert run(built, tmp_path / name, "--seed", "0", "--no-frames") == 0
        logs.append((tmp_path / name / "events.jsonl").read_bytes())
    assert logs[0] == logs[1]
    one, other = (  # of seeds 0 and 3
        [e["at"] for e in events(folder) if e["event"] == "seen"]
        for folder in (tmp_path / "a", ran[0])
    )
    assert one[0] != other[0]


@pytest.mark.usefixtures("one_render_a_state")
@pytest.mark.parametrize(
    "seed",
    [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 8))],
)
def test_done_is_never_said_of_a_failed_assembly(
    built: Path, tmp_path: Path, seed: int
) -> None:
    status = run(built, tmp_path / "run", "--seed", str(seed), "--no-frames")
    assert (status == 0) == summary(tmp_path / "run")["cell_verdict"]["success"]


@pytest.mark.usefixtures("one_render_a_state")
@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        ("stick", {"MP850", "MP854"}),
        ("block", {"MP850", "MP851", "MP852", "MP853"}),
        ("no_part", {"MP820"}),
        ("mirror_camera", {"MP833"}),
    ],
)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_fault_is_caught(
    built: Path, tmp_path: Path, fault: str, codes: set[str], seed: int
) -> None:
    folder = tmp_path / "run"
    status = run(built, folder, "--seed", str(seed), "--no-frames", "--inject", fault)
    assert status in (1, 3)
    found = summary(folder)
    assert found["code"] in codes
    assert not found["done"]


@pytest.mark.usefixtures("one_render_a_state")
def test_nothing_moves_after_a_fault(built: Path, tmp_path: Path) -> None:
    assert run(built, tmp_path / "run", "--no-frames", "--inject", "no_part") == 1
    names = [e["event"] for e in events(tmp_path / "run")]
    failed = names.index("failed")
    assert names[failed + 1 :] == ["end"]
    assert "jaws" not in names


@pytest.mark.usefixtures("one_render_a_state")
def test_a_fault_that_nothing_met_is_told(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--inject", "no_part", "--inject", "stick@release")
    assert run(built, tmp_path / "run", "--no-frames", *asked) == 1
    said = "injected faults: no_part, stick@release (met by nothing)"
    assert said in capsys.readouterr().out
    assert (tmp_path / "run" / "summary.txt").read_text("utf-8").endswith(f"{said}\n")
    found = summary(tmp_path / "run")
    assert found["faults"] == ["no_part", "stick@release"]
    assert found["idle_faults"] == ["stick@release"]


def test_check_and_dry_run_move_nothing(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for mode in ("check", "dry-run"):
        assert run(built, tmp_path / "run", "--mode", mode) == 0
        assert not (tmp_path / "run").exists()
    out = capsys.readouterr().out
    assert "12 steps fit the station" in out
    assert "look at shaft_plate.post at 6.9 x, focus -10 um: circle_caliper" in out


def test_an_infeasible_plan_is_refused(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = edited(built, tmp_path, '"status": "feasible"', '"status": "infeasible"')
    assert run(plan, tmp_path / "run") == 1
    assert "error[MP801]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"format_version": "2.9"', '"format_version": "3.0"'),
        ('"steps": [', '"steps": ['[:-1]),
        ('"kind": "grasp"', '"kind": "grip"'),
        ('"opening_um": 96.0', '"opening_um": NaN'),
        ('"opening_um": 96.0', '"opening_um": 1' + "0" * 400),
    ],
    ids=["newer version", "not JSON", "unknown action", "nan", "too large"],
)
def test_a_plan_that_cannot_be_read_is_refused(
    built: Path, tmp_path: Path, old: str, new: str
) -> None:
    assert run(edited(built, tmp_path, old, new), tmp_path / "run") == 2
    assert not (tmp_path / "run").exists()


def test_a_task_is_no_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "task.yaml").write_text("microplan: 1\n", encoding="utf-8")
    assert run(tmp_path / "task.yaml", tmp_path / "run") == 2
    assert "compile it first" in capsys.readouterr().err
    assert run(tmp_path / "none.json", tmp_path / "run") == 2
    told = capsys.readouterr().err
    assert "none.json: No such file" in told
    assert "microplan compile makes a plan folder" in told


def test_a_call_without_a_station_is_told_of_the_simulated_one(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(built)]) == 2
    told = capsys.readouterr().err
    assert "--station sim is the simulated cell" in told
    assert "there is no" not in told
    assert main([str(tmp_path / "none.plan")]) == 2
    assert f"there is no {tmp_path / 'none.plan'}" in capsys.readouterr().err


def test_a_missing_world_and_a_missing_plan_are_the_callers_fault(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(built, tmp_path / "copy.plan"))
    (copy / "world.json").unlink()
    assert run(copy, tmp_path / "run") == 2
    assert run(tmp_path / "nowhere", tmp_path / "run") == 2
    assert "error[MP802]" in capsys.readouterr().err


def test_a_wrong_call_is_two_and_help_is_zero(built: Path) -> None:
    assert main([str(built)]) == 2
    assert main([str(built), "--station", "sim", "--seed", "-1"]) == 2
    assert main(["--help"]) == 0
    assert main(["--version"]) == 0


def test_a_camera_is_the_simulated_cells(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = str(tmp_path / "station.toml")
    assert main([str(built), "--station", station, "--camera", "solid"]) == 2
    assert "error[MP804]: --seed, --inject and --camera are" in capsys.readouterr().err
    assert main([str(built), "--station", "sim", "--camera", "none"]) == 2
    solid, quick = find_site("sim", built), find_site("sim", built, camera="quick")
    assert solid.cell is not None
    assert quick.cell is not None
    assert isinstance(solid.cell.camera.pictures, SolidPictures)
    assert isinstance(quick.cell.camera.pictures, QuickPictures)


def test_a_finding_names_the_file_that_is_at_fault(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "nope.toml"
    assert main([str(built), "--station", str(station)]) == 2
    told = capsys.readouterr().err
    assert f"error[MP812]: {station}: No such file or directory\n" in told
    assert f"--> {station}\n" in told
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years")
    assert run(built, tmp_path / "thesis") == 2
    assert f"--> {tmp_path / 'thesis'}\n" in capsys.readouterr().err


def test_a_folder_that_is_no_run_folder_is_not_touched(
    built: Path, tmp_path: Path
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years", encoding="utf-8")
    assert run(built, tmp_path / "mine") == 2
    assert (tmp_path / "mine" / "thesis.txt").read_text(encoding="utf-8") == "years"


def test_what_no_run_left_in_a_run_folder_is_never_deleted(
    built: Path,
    ran: tuple[Path, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = Path(shutil.copytree(ran[0], tmp_path / "mine"))
    (folder / "thesis").mkdir()
    (folder / "thesis" / "one.txt").write_text("years", encoding="utf-8")
    assert run(built, folder, "--discard") == 2
    assert "mine holds thesis, which no run left there" in capsys.readouterr().err
    assert (folder / "thesis" / "one.txt").exists()
    assert (folder / "summary.json").exists()


def test_a_fault_of_a_step_that_the_plan_has_not_is_refused(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(built, tmp_path / "run", "--inject", "block@isnert") == 2
    assert "block@isnert: the plan has no step 'isnert'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("one_render_a_state")
def test_a_plan_that_acts_and_never_verifies_is_not_done(
    built: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(built, tmp_path / "copy.plan"))
    plan = parse_plan((copy / "plan.json").read_text(encoding="utf-8"))
    text = dump_plan(replace(plan, steps=plan.steps[:-1]))
    (copy / "plan.json").write_text(text, encoding="utf-8")
    assert run(copy, tmp_path / "run", "--seed", "0", "--no-frames") == 1
    assert summary(tmp_path / "run")["code"] == "MP855"


def test_an_interrupt_stops_the_run(built: Path, tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.5)  # a run that keeps frames takes longer
    try:
        assert run(built, tmp_path / "run") == 4
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert events(tmp_path / "run")[-1]["event"] == "stopped"


def test_ctrl_c_lets_the_motion_end_and_stops_where_nobody_can_be_asked(
    built: Path, tmp_path: Path
) -> None:
    def hit(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGALRM, hit)
    signal.setitimer(signal.ITIMER_REAL, 0.5)  # a run that keeps frames takes longer
    try:
        assert run(built, tmp_path / "run") == 4
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    log = events(tmp_path / "run")
    assert [e["event"] for e in log[-2:]] == ["failed", "end"]
    assert log[-1]["code"] == "MP860"
    names = [e["event"] for e in log]
    assert names.count("move") - names.count("moved") in (0, 1)
    assert summary(tmp_path / "run")["code"] == "MP860"
