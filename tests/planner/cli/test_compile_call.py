"""`microplan compile`: golden plans compared and renewed; progress and timings."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from microplan.planner.cli.compiling import _with_findings
from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.store.folder import PlanBytes
from tests.planner.examples import GRASP, between_jaws, change, copy_example, cut

RELEASE = "{id: release, do: release, target: gear, opening_um: 130}"
Compile = Callable[..., int]


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """Return a task of two steps without a look: compiled in no time."""
    file = copy_example(tmp_path / "task")
    between_jaws(file)
    cut(file, GRASP, RELEASE)
    return file


@pytest.fixture
def compiled(task: Path, tmp_path: Path) -> Compile:
    """Return what compiles the task into `new`, against a golden plan."""

    def run(*words: str) -> int:
        out = str(tmp_path / "new")
        return main(["compile", str(task), "-o", out, "--preset", "fast", *words])

    return run


def last_line(text: str) -> str:
    """Return the last line of a text."""
    return text.splitlines()[-1]


def test_nothing_is_renewed_that_is_not_named(
    compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compiled("--update") == 2
    assert "--golden" in capsys.readouterr().err


BOTH = (
    "P(success) > 0.9999 in both, feasible in both; "
    "not in P(success): grasp (may slip), release (may stick)"
)


@pytest.mark.parametrize("name", ["golden.json", "golden"])
def test_a_golden_plan_is_made_compared_and_renewed(
    name: str,
    task: Path,
    tmp_path: Path,
    compiled: Compile,
    capsys: pytest.CaptureFixture[str],
) -> None:
    golden = tmp_path / "kept" / name
    assert compiled("--golden", str(golden), "--update") == 0
    plan = golden if golden.suffix else golden / "plan.json"
    assert json.loads(plan.read_text(encoding="utf-8"))["name"] == "gear-on-shaft"
    capsys.readouterr()
    assert compiled("--golden", str(golden)) == 0
    heard = capsys.readouterr()
    assert "\nthe plans mean the same\n" in heard.out
    assert last_line(heard.out) == BOTH
    change(task, "gear, opening_um: 130}", "gear, opening_um: 125}")
    assert compiled("--golden", str(golden)) == 1
    heard = capsys.readouterr()
    assert "release/action/opening_um: 130 um became 125 um (-3.85 %)" in heard.out
    assert last_line(heard.out) == BOTH
    assert "different[MP710]" in heard.err
    assert "--update" in heard.err
    assert compiled("--golden", str(golden), "--update") == 0
    assert compiled("--golden", str(golden)) == 0


def test_a_tolerance_of_the_users_counts(
    task: Path, tmp_path: Path, compiled: Compile
) -> None:
    golden = str(tmp_path / "golden.json")
    assert compiled("--golden", golden, "--update") == 0
    change(task, "gear, opening_um: 130}", "gear, opening_um: 125}")
    stated = ("release=ignore", "requirements=ignore", "provenance=ignore")
    words = [w for pattern in stated for w in ("--tolerance", pattern)]
    assert compiled("--golden", golden, *words) == 0


def test_without_a_golden_plan_nothing_is_compiled(
    tmp_path: Path, compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "none.json"
    assert compiled("--golden", str(missing)) == 2
    heard = capsys.readouterr()
    assert "error[MP704]" in heard.err
    assert f"--> {missing}" in heard.err
    assert not (tmp_path / "new").exists()


def test_a_folder_with_other_things_is_left_alone(
    tmp_path: Path, compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "photographs"
    other.mkdir()
    (other / "a.txt").write_text("mine", encoding="utf-8")
    assert compiled("--golden", str(other), "--update") == 2
    assert "MP701" in capsys.readouterr().err
    assert [f.name for f in other.iterdir()] == ["a.txt"]


def test_a_golden_file_of_another_kind_is_left_alone(
    task: Path, tmp_path: Path, compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "package.json"
    other.write_text('{"name": "mine"}', encoding="utf-8")
    assert compiled("--golden", str(other), "--update") == 2
    said = capsys.readouterr().err
    assert "error[MP701]" in said
    assert f"--> {other}" in said
    assert other.read_text(encoding="utf-8") == '{"name": "mine"}'
    assert not (tmp_path / "new").exists()  # told before the work


def test_what_is_not_listed_is_shown_by_the_command_named(
    tmp_path: Path, compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    golden = tmp_path / "kept plans" / "golden.json"
    assert compiled("--golden", str(golden), "--update") == 0
    data = json.loads(golden.read_text(encoding="utf-8"))
    travel = data["requirements"]["travel"]
    for axis, ends in travel.items():
        travel[axis] = [2 * (end or 100) for end in ends]
    golden.write_text(json.dumps(data), encoding="utf-8")
    capsys.readouterr()
    assert compiled("--golden", str(golden)) == 1
    *_, said, verdict = capsys.readouterr().out.splitlines()
    count, command = said.split(" not listed; microplan ")
    assert int(count) > 0
    assert command.endswith(" shows them")
    assert main(shlex.split(command.removesuffix(" shows them"))) == 1
    shown = capsys.readouterr().out
    assert "not listed" not in shown
    assert last_line(shown) == verdict
    assert all(f"requirements/travel/{axis}/0" in shown for axis in travel)


def test_nothing_is_left_beside_a_golden_plan(
    tmp_path: Path, compiled: Compile
) -> None:
    kept = tmp_path / "kept"
    for name in ("golden.json", "golden"):
        assert compiled("--golden", str(kept / name), "--update") == 0
        assert compiled("--golden", str(kept / name), "--update") == 0
    assert sorted(p.name for p in kept.iterdir()) == ["golden", "golden.json"]
    shutil.rmtree(kept)


def test_timings_are_told_if_asked_for(
    compiled: Compile, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compiled() == 0
    assert " in all" not in capsys.readouterr().err
    assert compiled("--timings", "--no-cache") == 0
    lines = capsys.readouterr().err.splitlines()
    told = [line for line in lines if re.fullmatch(r" *\d+\.\d{3} s .*", line)]
    assert {line.split()[-1] for line in told} == {"grasp", "release", "all"}
    assert lines[-3:] == told  # below the notes, of which a look may have many
    assert any(line.startswith("note[") for line in lines[:-3])
    seconds = [float(line.split()[0]) for line in told]
    assert seconds[0] >= seconds[1]
    assert sum(seconds[:2]) <= seconds[2] + 2e-3  # rounded to milliseconds


def test_findings_lie_beside_the_plan_and_in_its_report(
    compiled: Compile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compiled("--report", "-v") == 0
    heard = capsys.readouterr()
    assert heard.out.startswith("gear-on-shaft: feasible, P(success) ")
    found = json.loads((tmp_path / "new" / "findings.json").read_text(encoding="utf-8"))
    page = (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    assert found
    for finding in found:
        assert finding["message"] in heard.err
        assert finding["code"] in page
        assert finding["where"]["file"] == "task.yaml"  # as seen from the task


def test_findings_name_files_as_seen_from_the_task() -> None:
    made = PlanBytes(name="n", files={"plan.json": b""}, timings={}, summary="")
    report = Report()
    report.note("MP306", Span(file="a/data/gear.dxf"), "a/task.yaml: 3 um/s", "see a/b")
    report.note("MP306", Span(file="data/a/x.dxf"), "'a/x' at data/a/x", "ma/x")
    kept = json.loads(_with_findings(made, report, Path("a")).files["findings.json"])
    assert [each["where"]["file"] for each in kept] == ["data/gear.dxf", "data/a/x.dxf"]
    assert [each["message"] for each in kept] == [
        "task.yaml: 3 um/s",
        "'x' at data/a/x",
    ]
    assert [each["hint"] for each in kept] == ["see b", "ma/x"]


def test_a_folder_of_any_name_is_compiled_in(task: Path, tmp_path: Path) -> None:
    odd = task.parent.rename(tmp_path / os.fsdecode(b"caf\xe9"))
    words = ["compile", str(odd / "task.yaml"), "--preset", "fast", "--report"]
    assert main(words) == 0
    assert json.loads((odd / "gear-on-shaft.plan" / "inputs.json").read_bytes())


def test_timings_stand_below_everything(compiled: Compile) -> None:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
        assert (
            compiled() == compiled("--timings") == 0
        )  # the second time from the cache
    assert shown.getvalue().splitlines()[-1].endswith(" in all")


def test_progress_is_told_to_a_terminal_alone(task: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "microplan.planner.cli.main", "compile", str(task)]
    words += ["-o", str(tmp_path / "new"), "--preset", "fast"]
    ours, theirs = pty.openpty()
    done = subprocess.run(words, stderr=theirs, stdout=subprocess.PIPE, check=True)
    heard = os.read(ours, 1 << 16).decode()
    os.close(theirs)
    os.close(ours)
    first, *_ = [line for line in heard.split("\r") if line]
    assert first.startswith("compiling grasp: 0 of 2 steps")
    assert heard.index("\r" + " " * 79 + "\r") < heard.index("note")  # cleared
    assert b"compiling" not in done.stdout
    silent = subprocess.run(words, capture_output=True, check=True)
    assert b"compiling" not in silent.stderr + silent.stdout
