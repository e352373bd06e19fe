"""The commands of the workflow and the hooks that are given as examples."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
import yaml

from microplan.planner.cli.main import main
from microplan.planner.diff.changes import KINDS
from tests.planner.examples import GRASP, ROOT, between_jaws, change, copy_example, cut

CI = ROOT / "examples" / "ci"
PAGE = ROOT / "docs" / "ci.md"


def workflow() -> list[str]:
    """Return the commands of the workflow that run microplan."""
    data = yaml.safe_load((CI / "microplan.yml").read_text(encoding="utf-8"))
    runs = [step.get("run", "") for step in data["jobs"]["plan"]["steps"]]
    return [run for run in runs if run.startswith("microplan ")]


def hooks() -> list[str]:
    """Return the commands of the hooks."""
    file = CI / "pre-commit-config.yaml"
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    return [hook["entry"] for hook in data["repos"][0]["hooks"]]


def documented() -> list[str]:
    """Return the commands of the page that name a task."""
    text = PAGE.read_text(encoding="utf-8")
    (block,) = re.findall(r"^```\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [line.partition("#")[0].strip() for line in block.splitlines()]
    return [line for line in lines if "task.yaml" in line]


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a task of two steps and its golden plan, and go there."""
    file = copy_example(tmp_path / "task")
    between_jaws(file)
    cut(file, GRASP, "{id: release, do: release, target: gear, opening_um: 130}")
    monkeypatch.chdir(file.parent)
    assert [run(command) for command in documented()] == [0, 0]
    return file.parent


def run(command: str) -> int:
    program, *words = shlex.split(command)
    assert program == "microplan"
    return main(words)


@pytest.mark.parametrize("commands", [workflow(), hooks()])
def test_commands_pass_as_long_as_nothing_changes(
    commands: list[str], repository: Path
) -> None:
    assert len(commands) == 2
    assert [run(command) for command in commands] == [0, 0]
    change(repository / "task.yaml", "gear, opening_um: 130}", "gear, opening_um: 125}")
    shutil.rmtree(repository / "build")
    assert [run(command) for command in commands] == [0, 1]
    change(repository / "task.yaml", "gear, opening_um: 125}", "gear, opening_um: x}")
    assert [run(command) for command in commands] == [2, 2]


def test_the_page_lists_every_kind() -> None:
    rows = re.findall(
        r"^\| `(\w+)` \| \w.+ \|$", PAGE.read_text(encoding="utf-8"), re.M
    )
    assert [row for row in rows if row in KINDS] == list(KINDS)
