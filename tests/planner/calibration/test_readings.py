"""Tables of readings: what they state, and every mistake as a finding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from microplan.planner.calibration.picture_intake import PictureIntake
from microplan.planner.calibration.readings import (
    READINGS,
    PictureReadings,
    read_readings,
    readings_of_pages,
)
from microplan.planner.source.diagnostics import Report
from tests.planner.measure.small_look import save

NAMES = ("a.png", "b.png")


def table(folder: Path, text: str, names: tuple[str, ...] = NAMES) -> Path:
    """Write a table, and pictures that differ."""
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        save(folder / name, np.full((16, 16), number, dtype=np.uint8))
    (folder / READINGS).write_text(text, encoding="utf-8")
    return folder


def read(folder: Path) -> PictureReadings:
    report = Report()
    found = read_readings(folder, report)
    assert found is not None, report.found
    return found


@pytest.mark.parametrize(
    ("head", "kind"),
    [("x_um", "stage"), ("stage_y_um", "stage"), ("z_um", "focus"),
     ("focus_um", "focus"), ("light", "light"), ("group", "still")],
)  # fmt: skip
def test_what_changes_from_row_to_row_is_the_kind(
    tmp_path: Path, head: str, kind: str
) -> None:
    found = read(table(tmp_path, f"\ufefffile, {head}\nb.png, 1\n\na.png, 2.5\n"))
    assert found.kind == kind
    assert [row.name for row in found.rows] == ["b.png", "a.png"]
    assert [path.name for path in found.files] == ["b.png", "a.png"]
    assert found.by_name["a.png"].light == (2.5 if head == "light" else 1.0)


def test_a_part_may_be_at_several_places_under_a_condenser(tmp_path: Path) -> None:
    text = "file,condenser_aperture,x_um\na.png,.1,0\nb.png,.2,5\n"
    found = read(table(tmp_path, text))
    assert found.kind == "condenser"
    assert [row.condenser_aperture for row in found.rows] == [0.1, 0.2]


@pytest.mark.parametrize(
    ("head", "first", "second", "kind"),
    [
        ("z_um", "1", "2", "focus"),
        ("x_um", "1", "2", "stage"),
        ("light", "1", "2", "light"),
        ("group", "a", "b", "still"),
        ("scene", "even", "even", "field"),
    ],
)
def test_a_condenser_that_stays_is_no_change(
    tmp_path: Path, head: str, first: str, second: str, kind: str
) -> None:
    rows = f"a.png,.2,{first}\nb.png,.2,{second}\n"
    found = read(table(tmp_path, f"file,condenser_aperture,{head}\n{rows}"))
    assert found.kind == kind
    assert {row.condenser_aperture for row in found.rows} == {0.2}


@pytest.mark.parametrize(
    ("text", "said", "hint"),
    [
        ("", "has no column 'file'", "columns: file, group"),
        ("file,colour\na.png,1\nb.png,2\n", "no column 'colour' is known", "x_um"),
        ("file;x_um\na.png;1\n", "no column 'file;x_um'", "separated by commas"),
        ("x_um\n1\n2\n", "has no column 'file'", "columns"),
        ("file,z_um,focus_um\na.png,1,1\n", "'focus_um' states again", "once"),
        ("file,x_um\n", "the table has no rows", "each picture"),
        ("file,x_um\na.png\n", "1 cells, the head has 2", "a cell for each"),
        ("file,x_um\na.png,one\n", "is no number: 'one'", ""),
        ("file,x_um\na.png,1_0\n", "is no number: '1_0'", ""),
        ("file,x_um\na.png,\u0663\n", "is no number", ""),
        ("file,x_um\na.png,1e300\n", "x_um must be within 1e+06, got 1e+300", ""),
        ("file,z_um\na.png,-2e6\n", "z_um must be within 1e+06", ""),
        ("file,light\na.png,1e13\n", "at most 1e+12, got 1e+13", ""),
        ("file,x_um\na.png," + "1" * 140_000, "is no row of a table: field", ""),
        ("a" * 140_000, "is no row of a table: field", "short name"),
        ("file,x_um\na.png,inf\n", "x_um must be finite", ""),
        ("file,light\na.png,-1\n", "light must be 0 or more", ""),
        ("file,condenser_aperture\na.png,0\nb.png,.2\n", "must be above 0, and", ""),
        ("file,condenser_aperture\na.png,30\nb.png,.2\n", "at most 2, got 30", ""),
        ("file,condenser_aperture\na.png,-1\nb.png,.2\n", "got -1", "look at its unit"),
        ("file,condenser_aperture\na.png,nan\nb.png,.2\n", "be finite", "the number"),
        (
            "file,scene\na.png,evne\nb.png,even\n",
            "a.png: scene is 'evne'",
            "write even",
        ),
        (
            "file,condenser_aperture,z_um\na.png,.1,1\nb.png,.2,2\n",
            "condenser and focus change",
            "one at a time",
        ),
        (
            "file,condenser_aperture\na.png,.1\nb.png,.1\n",
            "condenser_aperture does not change",
            "two settings",
        ),
        ("file,x_um\n../a.png,1\n", "names no picture of this folder", ""),
        ("file,x_um\na.png,1\na.png,2\n", "a.png is in line 2 already", "FILE[NUMBER]"),
        ("file,x_um\na.png,1\nb.png,2\nc.png,3\n", "c.png of the table is not", "row"),
        ("file,x_um\na.png,1\n", "b.png has no readings", "add a row"),
        ("file,x_um,z_um\na.png,1,2\nb.png,3,4\n", "stage and focus change", "folder"),
    ],
)
def test_a_table_that_is_not_clear_is_a_finding(
    tmp_path: Path, text: str, said: str, hint: str
) -> None:
    report = Report()
    assert read_readings(table(tmp_path, text), report) is None
    (found,) = report.found
    assert found.code == "MP905"
    assert said in found.message
    assert hint in found.hint


def test_bytes_that_are_no_text_are_a_finding(tmp_path: Path) -> None:
    (table(tmp_path, "") / READINGS).write_bytes(b"\xff\xfe\x00")
    report = Report()
    assert read_readings(tmp_path, report) is None
    assert "cannot be read" in report.found[0].message


def test_pages_of_a_file_are_named_by_number(tmp_path: Path) -> None:
    """Else they have no readings."""
    pages = np.random.default_rng(0).integers(0, 255, (3, 16, 16)).astype(np.uint8)
    text = "file,x_um\n" + "".join(f"s.tif[{k}],{k}\n" for k in range(3))
    more = text + "s.tif[3],9\n"
    for rows, count in ((text, 3), ("file,x_um\ns.tif,1\n", 0), (more, 3)):
        folder = table(tmp_path / str(len(rows)), rows, ())
        save(folder / "s.tif", pages)
        report = Report()
        found = read_readings(folder, report)
        assert found is not None
        intake = PictureIntake(report=report, camera_bits=8, bits=None)
        pairs = list(readings_of_pages(found, intake))
        assert [row.x_um for row, _ in pairs] == list(range(count))
        assert report.failed == (rows != text)
