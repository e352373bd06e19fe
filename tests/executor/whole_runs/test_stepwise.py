"""--step: every step, and what cannot be undone, waits for the operator."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import Plan, ReleaseAction, parse_plan
from tests.executor.bench import QUICK, Folder, assembly, step, world
from tests.executor.bench import robot_to as robot


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan folder of a look, a move, and a release after a move."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker = Folder(folder)
    plan = assembly(maker)
    release = ReleaseAction(target="gear", tool="tweezers", opening_um=140.0)
    last = step("let_go", release, moves=(robot(z_um=390.0),))
    last = replace(last, irreversible=True)
    found = world()
    parts = tuple(replace(p, sigma_xy_um=min(p.sigma_xy_um, 8.0)) for p in found.parts)
    maker.write(
        replace(plan, steps=(*plan.steps[:1], last)), replace(found, parts=parts)
    )
    return folder


@pytest.fixture
def answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[str], None]]:
    """Return what puts lines where the operator's answers come from."""
    opened: list[Any] = []

    def answer(text: str) -> None:
        path = tmp_path / "answers"
        path.write_text(text, "utf-8")
        opened.append(path.open(encoding="utf-8"))
        monkeypatch.setattr("sys.stdin", opened[-1])

    yield answer
    for stream in opened:
        stream.close()


def run(plan: Path, folder: Path) -> int:
    words = [
        *QUICK,
        "--run-dir",
        str(folder),
        "--no-frames",
        "--step",
    ]
    return main([str(plan), *words])


def events(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "events.jsonl").read_text("utf-8")
    return [json.loads(line) for line in text.splitlines()]


def test_steps_and_what_cannot_be_undone_wait(
    built: Path,
    tmp_path: Path,
    answers: Callable[[str], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    answers("\n\n\n")
    assert run(built, tmp_path / "run") == 1  # acts and never verifies: MP855
    err = capsys.readouterr().err
    assert err.count("next: ") == 3
    assert "next: let_go: release\n  move robot.z_um=390\n" in err
    assert "next: let_go: open tweezers to 140 um: gear (cannot be undone)" in err
    log = [e["event"] for e in events(tmp_path / "run")]
    asked = [k for k, name in enumerate(log) if name == "asked"]
    assert len(asked) == 3
    # asked before the first look and its probe, before the next step's move, and
    # between that and the jaws
    assert asked[0] < log.index("look") < log.index("probe") < asked[1]
    move = log.index("move", asked[1])
    assert asked[1] < move < log.index("moved", move) < asked[2] < log.index("jaws")


@pytest.mark.parametrize("text", ["\n\nq\n", "\n\n", "\n\nyes\n"])
def test_anything_but_an_empty_line_stops_before_it_happens(
    built: Path, tmp_path: Path, answers: Callable[[str], None], text: str
) -> None:
    answers(text)
    assert run(built, tmp_path / "run") == 4
    log = [e["event"] for e in events(tmp_path / "run")]
    assert "moved" in log
    assert "jaws" not in log
    assert events(tmp_path / "run")[-1]["code"] == "MP860"


def test_nobody_to_ask_is_a_wrong_call(
    built: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Path(os.devnull).open(encoding="utf-8") as nobody:
        monkeypatch.setattr("sys.stdin", nobody)
        assert run(built, tmp_path / "run") == 2
    monkeypatch.setattr("sys.stdin", None)
    assert run(built, tmp_path / "run") == 2
    assert capsys.readouterr().err.count("error[MP804]: --step needs") == 2
    assert not (tmp_path / "run").exists()
    check = [*QUICK, "--mode", "check", "--step"]
    assert main([str(built), *check]) == 2


def test_the_time_at_the_gate_is_no_time_of_the_step(built: Path) -> None:
    slow, quick = (times(built, wait_s) for wait_s in (7.0, 0.0))
    # zoom, focus, robot and jaws: each may be seen to stand one poll of .02 s later
    assert slow == pytest.approx(quick, abs=4 * 0.02 + 1e-9)


def times(folder: Path, wait_s: float) -> list[float]:
    """Return the steps' times if the operator waits before each."""
    plan: Plan = parse_plan((folder / "plan.json").read_text("utf-8"))
    cell = build_cell(world(), 0)
    rig = Rig(
        plan=plan,
        station=cell.station,
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=Artifacts.from_folder(plan, folder),
        journal=Journal(io.StringIO(), cell.clock),
        frames=Frames(None),
        gate=lambda _: cell.clock.wait(wait_s),
    )
    result = run_plan(rig)
    return [*(s.time_s for s in result.steps), result.time_s]
