"""Files are read once, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.files import named_file, read_bytes
from microplan.planner.source.schema import did_you_mean
from microplan.planner.task.read_task import load_task
from tests.planner.examples import EXAMPLE

AT = Span(file="task.yaml", line=3)


def read(path: Path, most: int = 8) -> tuple[bytes | None, list[tuple[str, str]]]:
    """Return what is read, and codes with messages."""
    report = Report()
    data = read_bytes(path, "part", AT, report, most=most)
    assert all(finding.where == AT for finding in report.found)
    return data, [(finding.code, finding.message) for finding in report.found]


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    (tmp_path / "part").write_bytes(bytes(8))
    assert read(tmp_path / "part") == (bytes(8), [])
    assert read(tmp_path / "part", 7) == (
        None, [("MP009", "part is larger than 7 bytes")]
    )  # fmt: skip


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")  # nobody writes to it: reading would wait for ever
    said = {
        "pipe": "it is no regular file",
        "none": "No such file or directory",
        ".": "Is a directory",
        "a\0b": "embedded null byte",
    }
    for name, why in said.items():
        assert read(tmp_path / name) == (None, [("MP001", f"cannot read part: {why}")])


def test_a_file_that_is_not_there_is_named_after_one_that_is(tmp_path: Path) -> None:
    for name in ("gear18.dxf", "plate.dxf"):
        (tmp_path / name).write_bytes(b"")
    hints = []
    for name in ("gear.dxf", "no/gear.dxf", "nothing"):
        report = Report()
        assert read_bytes(tmp_path / name, name, AT, report, most=9) is None
        hints.append(report.found[0].hint)
    assert hints == ["did you mean 'gear18.dxf'?", "", ""]


def test_a_file_that_may_be_meant_is_named_with_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    (folder / "gear.dxf").write_bytes(b"")
    for asking in (tmp_path / "task.yaml", Path("task.yaml")):
        report, where = Report(), Span(file=str(asking), line=1, column=1)
        file = (asking.parent / "parts" / "gear18.dxf").as_posix()
        assert read_bytes(folder / "gear18.dxf", file, where, report, most=9) is None
        assert report.found[0].hint == "did you mean 'parts/gear.dxf'?"


def test_a_name_that_ends_in_a_slash_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "part").write_bytes(b"")
    report = Report()
    assert named_file("part", AT, tmp_path, report) == (tmp_path / "part", "part")
    assert named_file("part/", AT, tmp_path, report) is None
    (found,) = report.found
    assert (found.code, found.message) == (
        "MP010", "'part/' names a folder, a file is needed"
    )  # fmt: skip


def test_a_task_opens_every_file_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing can change between a first look at a file and its reading."""
    opened: list[str] = []
    plain = Path.open

    def spy(self: Path, *args: Any, **kwargs: Any) -> Any:
        opened.append(self.name)
        return plain(self, *args, **kwargs)

    monkeypatch.setattr(Path, "open", spy)
    assert load_task(EXAMPLE / "task.yaml", Report()) is not None
    mine = [name for name in opened if not name.endswith(".json")]  # schemas
    assert sorted(mine) == ["gear18.dxf", "shaft_plate.dxf", "task.yaml",
                            "tweezer_fingers.dxf", "workcell.yaml"]  # fmt: skip


def test_the_file_that_asks_is_not_meant(tmp_path: Path) -> None:
    for name in ("t.yaml", "wt.yaml"):
        (tmp_path / name).write_text("")
    report = Report()
    where = Span(file=str(tmp_path / "t.yaml"), line=1, column=1)
    assert read_bytes(tmp_path / "tt.yaml", "tt.yaml", where, report, most=9) is None
    (found,) = report.found
    assert found.hint == "did you mean 'wt.yaml'?"


@pytest.mark.parametrize("mu", ["\u00b5", "\u03bc"])
def test_a_micrometre_is_no_metre(mu: str) -> None:
    assert did_you_mean(f"{mu}m", ["um", "mm", "m", "inch"]) == "did you mean 'um'?"
