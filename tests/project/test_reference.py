"""The pages of docs/reference are what schemas, parsers and codes say, all of it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import microplan.executor.cli.main
import microplan.planner.cli.main
from microplan.schemas.files import json_schema

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "reference"


def keys(node: Any) -> set[str]:
    """Return every key that a schema names."""
    found: set[str] = set()
    if isinstance(node, dict):
        found |= set(node.get("properties", {}))
        for inner in node.values():
            found |= keys(inner)
    elif isinstance(node, list):
        for inner in node:
            found |= keys(inner)
    return found


def rows(name: str) -> list[dict[str, str]]:
    """Return the cells of all tables of a page by their heads; no cell is empty."""
    text, found = (PAGES / f"{name}.md").read_text(encoding="utf-8"), []
    heads: list[str] = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if line.startswith(("| `", "| [")):
            found.append({h: c for h, c in zip(heads, cells, strict=True) if c})
        elif line.startswith("| "):
            heads = cells
    return found


def test_the_pages_are_what_the_generator_writes() -> None:
    words = [sys.executable, "docs/reference.py", "--check"]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        words, cwd=ROOT, env=env, capture_output=True, text=True, check=False
    )
    assert done.stdout + done.stderr == ""
    assert done.returncode == 0


@pytest.mark.parametrize("name", json_schema.NAMES)
def test_every_key_of_a_format_is_told_and_explained(name: str) -> None:
    told = rows(name)
    assert {row["key"].strip("`") for row in told} == keys(json_schema.load(name))
    needed = {"key", "type", "default", "meaning"}
    assert [row for row in told if not needed <= row.keys()] == []


@pytest.mark.parametrize("name", ["task", "workcell", "station"])
def test_a_number_of_a_file_has_unit_and_range(name: str) -> None:
    numbers = [row for row in rows(name) if row["type"] == "number"]
    assert len(numbers) > 10
    assert [row["key"] for row in numbers if "unit" not in row] == []
    ranged = [row for row in numbers if name != "station"]  # its reader bounds few
    assert [row["key"] for row in ranged if "range" not in row] == []


def test_every_option_of_both_programs_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = (PAGES / "cli.md").read_text(encoding="utf-8")
    told = set(re.findall(r"--[a-z][a-z-]+", text))
    assert microplan.planner.cli.main.main(["--help"]) == 0
    helps = [capsys.readouterr().out]
    for command in re.findall(r"^    (\w+)  ", helps[0], re.MULTILINE):
        assert f"### `microplan {command}`" in text
        assert microplan.planner.cli.main.main([command, "--help"]) == 0
        helps.append(capsys.readouterr().out)
    assert microplan.executor.cli.main.main(["--help"]) == 0
    helps.append(capsys.readouterr().out)
    named = set(re.findall(r"--[a-z][a-z-]+", "".join(helps)))
    assert len(named) > 30
    assert named - {"--help"} <= told


def test_every_diagnostic_is_told_with_its_page() -> None:
    told = {row["code"][1:6] for row in rows("diagnostics")}
    pages = {page.stem for page in (ROOT / "docs" / "diagnostics").glob("MP*.md")}
    assert told == pages
