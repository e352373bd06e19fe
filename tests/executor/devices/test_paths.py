"""Paths that cannot be looked at, and names that can be no file's: codes, no crash."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.executor.cli.main import main
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station_file import is_file, is_folder, stays_in
from microplan.executor.record.plan_file import read_plan
from microplan.schemas.plan import MoveAction, Step, dump_plan
from tests.executor.bench import plan_of, stage_to, step

LONG = "n" * 300


def moving(name: str) -> Step:
    """Return a step that moves the stage."""
    return step(name, MoveAction(), moves=(stage_to(),))


@pytest.fixture
def plan(tmp_path: Path) -> str:
    """Return the file of a plan that looks at nothing."""
    path = tmp_path / "plan.json"
    path.write_text(dump_plan(plan_of([moving("away")])), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("MP804", ["--station", "sim", "--run-dir", LONG]),
        ("MP868", ["--station", "sim", "--resume", "--run-dir", LONG]),
        ("MP812", ["--station", LONG]),
        ("MP879", ["--mode", "report", "--from", LONG]),
        ("MP877", ["--mode", "replay", "--from", LONG]),
        ("MP879", ["--mode", "compare", "--runs", LONG]),
        ("MP812", ["--station", "loop"]),
        ("MP804", ["--station", "sim", "--run-dir", "loop"]),
        ("MP868", ["--station", "sim", "--resume", "--run-dir", "loop"]),
        ("MP879", ["--mode", "report", "--from", "loop"]),
    ],
)
def test_a_path_that_leads_nowhere_is_told(
    code: str,
    words: list[str],
    plan: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    assert main([plan, *words]) == 2
    assert f"error[{code}]" in capsys.readouterr().err


def test_a_plan_of_too_long_a_name_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([LONG, "--station", "sim"]) == 2
    assert "error[MP802]: cannot read" in capsys.readouterr().err


def test_what_cannot_be_looked_at_is_nothing(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert not is_file(tmp_path / LONG)
    assert not is_folder(tmp_path / LONG)
    assert not stays_in(tmp_path / "loop", tmp_path)
    assert not stays_in(tmp_path / "a\0b", tmp_path)
    assert not stays_in(tmp_path / ".." / "other", tmp_path)
    assert stays_in(tmp_path / "there", tmp_path)


@pytest.mark.parametrize(
    "name", ["", "../up", "a/b", "a\\b", "a\0b", "a\nb", "\ud800", "n" * 201]
)
def test_a_name_that_can_be_no_files_is_refused(name: str, tmp_path: Path) -> None:
    """Run folders and frames are called after the plan and its steps."""
    good = dump_plan(plan_of([moving("away")]))
    quoted = dump_plan(plan_of([moving(name)]))
    path = tmp_path / "plan.json"
    path.write_text(quoted, encoding="utf-8", errors="backslashreplace")
    with pytest.raises(ExecutorError, match=r"file's name|Unicode") as told:
        read_plan(path)
    assert told.value.code == "MP802"
    path.write_text(good, encoding="utf-8")
    assert read_plan(path).plan.steps[0].id == "away"


def test_two_steps_of_one_name_are_refused(tmp_path: Path) -> None:
    """A resumed run would take what one has done for what the other has."""
    path = tmp_path / "plan.json"
    path.write_text(dump_plan(plan_of([moving("a"), moving("a")])), encoding="utf-8")
    with pytest.raises(ExecutorError, match="two steps are called 'a'"):
        read_plan(path)
