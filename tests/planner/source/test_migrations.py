"""Older formats are rewritten as newer ones: keys and values, nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.migrations import (
    MIGRATIONS,
    VERSION_KEYS,
    Edit,
    Migration,
    edited,
    migrated,
)
from microplan.planner.source.schema import NEWEST
from microplan.planner.source.source import Source
from microplan.schemas.files import json_schema
from tests.planner.examples import EXAMPLE

OLD = """\
# my task, made in a hurry
microplan: 1       # the format
name:   gear
steps:             # \u00e4 \u4e2d \U0001f600 in a comment
  - {id: find, do: search, target: gear}   # flow
  - id: "put"
    do: insert   # block

    target: gear
speed_mm_s: 0.5
"""


def _renamed(source: Source) -> list[Edit]:
    """Return what version 2 calls otherwise: `do: search` is `locate`."""
    return [
        Edit(source.value("steps", k, "do"), "locate")
        for k, step in enumerate(source.items("steps"))
        if step["do"] == "search"
    ]


def _in_um(source: Source) -> list[Edit]:
    """Return what version 3 says in um per s, under another key."""
    if "speed_mm_s" not in source.mapping():
        return []
    speed = float(source.data["speed_mm_s"]) * 1e3
    return [
        Edit(source.key("speed_mm_s"), "speed_um_per_s"),
        Edit(source.value("speed_mm_s"), f"{speed:g}"),
    ]


# versions that never were
TABLE = (
    Migration(kind="task", since=1, says="'search' is 'locate'", edits=_renamed),
    Migration(kind="task", since=2, says="speeds are in um/s", edits=_in_um),
)


def try_it(
    path: Path, content: bytes, table: Sequence[Migration] = TABLE, newest: int = 3
) -> tuple[str | None, list[str], Report]:
    path.write_bytes(content)
    report = Report()
    found = migrated(path, path.name, report, table=table, newest=newest)
    if found is None:
        return None, [], report
    return found.text, list(found.says), report


def test_two_versions_on_only_what_changed_is_other(tmp_path: Path) -> None:
    text, says, _ = try_it(tmp_path / "task.yaml", OLD.encode())
    assert text == (
        OLD.replace("microplan: 1", "microplan: 3")
        .replace("do: search", "do: locate")
        .replace("speed_mm_s: 0.5", "speed_um_per_s: 500")
    )
    assert says == [
        "version 2: 'search' is 'locate'", "version 3: speeds are in um/s",
    ]  # fmt: skip


@pytest.mark.parametrize("end", ["\r\n", "\r", "\u2028", "\x85"])
def test_line_ends_stay_as_they_are(tmp_path: Path, end: str) -> None:
    text, _, _ = try_it(tmp_path / "task.yaml", OLD.replace("\n", end).encode())
    assert text is not None
    assert text.count(end) == OLD.count("\n")
    assert f"do: locate, target: gear}}   # flow{end}" in text


def test_a_second_migration_changes_nothing(tmp_path: Path) -> None:
    text, _, _ = try_it(tmp_path / "task.yaml", OLD.encode())
    assert text is not None
    again, says, _ = try_it(tmp_path / "task.yaml", text.encode())
    assert (again, says) == (text, [])


def test_a_workcell_has_its_own_steps(tmp_path: Path) -> None:
    text, _, report = try_it(tmp_path / "cell.yaml", b"microplan_workcell: 1\n")
    assert text is None  # the table has none for workcells
    assert [d.code for d in report.found] == ["MP105"]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("microplan: 4", "MP013"),
        ("microplan: 99999999999999999999", "MP013"),
        ("microplan: 0", "MP105"),
        ("microplan: -1", "MP105"),
        ("microplan: 1.0", "MP105"),
        ("microplan: true", "MP105"),
        ("microplan: '1'", "MP105"),
        ("microplan:", "MP105"),
        ("microplan: [1]", "MP105"),
        ("name: gear", "MP102"),
        ("microplan: 1\nmicroplan_workcell: 1", "MP102"),
        ("- 1", "MP102"),
        ("just text", "MP102"),
        ("microplan: &a 1", "MP005"),
        ("{", "MP003"),
        ("", "MP011"),
    ],
)
def test_what_cannot_be_migrated_is_said(tmp_path: Path, line: str, code: str) -> None:
    text, _, report = try_it(tmp_path / "task.yaml", line.encode())
    assert text is None
    assert [d.code for d in report.found] == [code]


def test_every_version_but_the_newest_has_a_step() -> None:
    """A change of a format that raises its version comes with the way from the last."""
    for key, kind in VERSION_KEYS.items():
        since = [step.since for step in MIGRATIONS if step.kind == kind]
        assert since == list(range(1, NEWEST))
        assert json_schema.load(kind)["properties"][key]["enum"] == [NEWEST]


@given(st.lists(st.integers(0, 9), min_size=1, max_size=5, unique=True))
def test_edits_in_any_order_are_the_same(places: list[int]) -> None:
    text = "0 1 2 3 4\n5 6 7 8 9"
    edits = [
        Edit(Span(file="", line=1 + p // 5, column=1 + 2 * (p % 5)), f"<{p}>")
        for p in places
    ]
    expected = "".join(f"<{c}>" if c in map(str, places) else c for c in text)
    assert edited(text, edits) == expected


def test_edits_that_overlap_are_refused() -> None:
    edits = [
        Edit(Span(file="", line=1, column=1, length=4), "a"),
        Edit(Span(file="", line=1, column=3, length=1), "b"),
    ]
    with pytest.raises(ValueError, match="overlap"):
        edited("0123456", edits)


@pytest.mark.parametrize("name", ["task.yaml", "workcell.yaml"])
def test_the_newest_is_printed_as_it_is_and_never_touched(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = (EXAMPLE / name).read_text(encoding="utf-8")
    file = tmp_path / name
    file.write_text(source, encoding="utf-8")
    before = (file.stat().st_mtime_ns, file.stat().st_ino)
    assert main(["migrate", str(file)]) == 0
    said = capsys.readouterr()
    assert said.out == source
    assert "newest version already" in said.err
    assert main(["migrate", str(file), "--in-place"]) == 0
    assert (file.stat().st_mtime_ns, file.stat().st_ino) == before
    assert yaml.safe_load(source)["name"]


def test_a_file_in_the_way_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("years", encoding="utf-8")
    call = ["migrate", str(EXAMPLE / "task.yaml"), "-o"]
    assert main([*call, str(mine)]) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert mine.read_text(encoding="utf-8") == "years"
    fresh = tmp_path / "new" / "task.yaml"
    assert main([*call, str(fresh)]) == 0
    assert fresh.read_bytes() == (EXAMPLE / "task.yaml").read_bytes()
    assert main([*call, str(tmp_path / "mine.yaml" / "below")]) == 2


def test_only_one_place_can_be_asked_for(tmp_path: Path) -> None:
    assert main(["migrate", "task.yaml", "--in-place", "-o", "x.yaml"]) == 2
