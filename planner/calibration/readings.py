"""Readings of devices for a series of pictures, from a table beside them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from microplan.planner.calibration.picture_intake import PictureIntake
from microplan.planner.calibration.table_cells import cells_of, number_of
from microplan.planner.measure.picture_files import PictureCounts
from microplan.planner.source.diagnostics import Report, Span

CODE = "MP905"
READINGS = "readings.csv"
# what a column may be called, and what it states; lengths in um
COLUMNS: Mapping[str, str] = {
    "file": "file", "group": "group", "still": "group", "light": "light",
    "x_um": "x_um", "stage_x_um": "x_um", "y_um": "y_um", "stage_y_um": "y_um",
    "z_um": "z_um", "focus_um": "z_um", "scene": "scene",
    "condenser_aperture": "condenser_aperture",
}  # fmt: skip
_NUMBERS = ("x_um", "y_um", "z_um", "light", "condenser_aperture")
_MOST_UM, _MOST_LIGHT = 1e6, 1e12  # of readings: beyond they are in another unit
_MOST_APERTURE = 2.0  # the medium's index at most
_MOST_SHOWN = 200  # characters of a line
_MOST_BYTES = 1 << 24  # of a table: some 300 000 pictures
_EACH = "a cell for each column"
_DIGITS = "digits, with a point and a sign at most"
_PAGE = "a picture of a file of several is named FILE[NUMBER], counted from 0"

EVEN = "even"  # scene: nothing is in the field
SeriesKind = Literal["still", "light", "stage", "focus", "field", "condenser"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureReading:
    """What devices read when a picture was taken; 0 where the table has no column."""

    name: str  # of the picture: "a.png", "a.tif[3]"
    x_um: float = 0.0  # of the stage
    y_um: float = 0.0
    z_um: float = 0.0  # of the focus drive
    light: float = 1.0  # proportional to the light, in any unit
    condenser_aperture: float | None = None  # numerical, of the illumination
    group: str = ""  # pictures between which nothing was moved or changed
    scene: str = ""  # `EVEN`, or anything: ""

    def __post_init__(self) -> None:
        for name in _NUMBERS:
            if not math.isfinite(getattr(self, name) or 0.0):
                raise ValueError(f"{name} must be finite, got {getattr(self, name)}")
        if self.scene not in ("", EVEN):
            raise ValueError(f"scene must be {EVEN!r} or empty, got {self.scene!r}")
        if not 0 <= self.light <= _MOST_LIGHT:
            limits = f"0 or more, and at most {_MOST_LIGHT:g}"
            raise ValueError(f"light must be {limits}, got {self.light:g}")
        aperture = self.condenser_aperture
        if aperture is not None and not 0 < aperture <= _MOST_APERTURE:
            limits = f"above 0, and at most {_MOST_APERTURE:g}"
            raise ValueError(f"condenser_aperture must be {limits}, got {aperture:g}")
        for name in _NUMBERS[:3]:
            if abs(getattr(self, name)) > _MOST_UM:
                got = f"got {getattr(self, name):g}"
                raise ValueError(f"{name} must be within {_MOST_UM:g}, {got}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureReadings:
    """A folder's table: its pictures in their order, and what was changed."""

    file: Path
    rows: tuple[PictureReading, ...]
    kind: SeriesKind

    @property
    def files(self) -> list[Path]:
        """Return the files of all pictures, each once, in the order of the table."""
        names = (row.name.partition("[")[0] for row in self.rows)
        return [self.file.parent / name for name in dict.fromkeys(names)]

    @property
    def by_name(self) -> dict[str, PictureReading]:
        """Return the rows by their pictures' names."""
        return {row.name: row for row in self.rows}


def read_readings(folder: Path, report: Report) -> PictureReadings | None:
    """Return the table of a folder; None, and findings MP905, if it is not clear.

    Parameters
    ----------
    folder : Path
        Holds pictures and `READINGS`, a table with commas and a head.
    report : Report
        Receives every mistake of the table.
    """
    file = folder / READINGS
    lines = _lines(file, report)
    if lines is None:
        return None
    before = len(report.found)
    names = _head(file, lines, report)
    rows = tuple(_rows(file, lines, names, report)) if names else ()
    if names and not rows and len(report.found) == before:
        _wrong(file, report, "the table has no rows", "a row for each picture")
    if len(report.found) > before:
        return None
    kind = series_kind(file, rows, report)
    if kind is None or not _all_there(file, rows, report):
        return None
    return PictureReadings(file=file, rows=rows, kind=kind)


def _wrong(
    file: Path, report: Report, message: str, hint: str, line: int = 0, text: str = ""
) -> None:
    """Report what is wrong with a table."""
    shown = text[:_MOST_SHOWN]
    at = Span(file=str(file), line=line, column=1 if line else 0, text=shown)
    report.error(CODE, at, message, hint)


def _lines(file: Path, report: Report) -> list[str] | None:
    """Return the lines of a table, None if it cannot be read."""
    try:
        data = file.read_bytes() if file.stat().st_size <= _MOST_BYTES else None
        text = None if data is None else data.decode("utf-8-sig")
    except (OSError, UnicodeError) as error:
        _wrong(file, report, f"cannot be read: {error}", "save it as text in UTF-8")
        return None
    if text is None:
        most = f"tables of up to {_MOST_BYTES >> 20} MiB are read"
        _wrong(file, report, "the table is too large", most)
        return None
    return text.splitlines()


def _head(file: Path, lines: Sequence[str], report: Report) -> list[str]:
    """Return what each column states; [] if that is not clear."""
    first = lines[0] if lines else ""
    said = cells_of(first)
    if isinstance(said, str):
        _wrong(file, report, said, "a short name for each column", 1, first)
        return []
    hint = "columns: " + ", ".join(COLUMNS) + "; separated by commas"
    unknown = [name for name in said if name not in COLUMNS]
    found = [COLUMNS.get(name, "") for name in said]
    twice = [n for k, n in enumerate(said) if n in COLUMNS and found[k] in found[:k]]
    if unknown:
        _wrong(file, report, f"no column {unknown[0]!r} is known", hint, 1, first)
    elif twice:
        message = f"column {twice[0]!r} states again what another states"
        _wrong(file, report, message, "state it once", 1, first)
    elif "file" not in found:
        _wrong(file, report, "the table has no column 'file'", hint, 1, first)
    else:
        return found
    return []


def _rows(
    file: Path, lines: Sequence[str], names: Sequence[str], report: Report
) -> Iterator[PictureReading]:
    """Yield the rows of a table; those that are none are reported."""
    seen: dict[str, int] = {}
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        cells = cells_of(line)
        row = (cells, _EACH) if isinstance(cells, str) else _row(names, cells)
        if isinstance(row, tuple):
            _wrong(file, report, *row, number, line)
        elif row.name in seen:
            message = f"{row.name} is in line {seen[row.name]} already"
            _wrong(file, report, message, _PAGE, number, line)
        else:
            seen[row.name] = number
            yield row


def _row(
    names: Sequence[str], cells: Sequence[str]
) -> PictureReading | tuple[str, str]:
    """Return a row, or why it is none and what is one."""
    if len(cells) != len(names):
        return f"{len(cells)} cells, the head has {len(names)}", _EACH
    said = dict(zip(names, cells, strict=True))
    name = said["file"]
    if not name or name != Path(name).name:
        return f"{name!r} names no picture of this folder", "no path, a name alone"
    values: dict[str, float] = {}
    for each in _NUMBERS:
        if each in said:
            try:
                values[each] = number_of(said[each])
            except ValueError:
                shown = said[each][:_MOST_SHOWN]
                return f"{each} of {name} is no number: {shown!r}", _DIGITS
    group, scene = said.get("group", ""), said.get("scene", "")
    if scene not in ("", EVEN):
        shown = scene[:_MOST_SHOWN]
        return f"{name}: scene is {shown!r}", f"write {EVEN}, or leave the cell empty"
    try:
        return PictureReading(name=name, group=group, scene=scene, **values)
    except ValueError as error:
        return f"{name}: {error}", "mend the number, and look at its unit"


def series_kind(
    file: Path, rows: Sequence[PictureReading], report: Report
) -> SeriesKind | None:
    """Return what was changed in a series; None, and MP905, if several things were.

    Stage readings and groups are places of the part where the condenser changes.
    """
    found: list[SeriesKind] = []
    apertures = {row.condenser_aperture for row in rows}
    if len(apertures) > 1:
        found.append("condenser")
    if len({row.light for row in rows}) > 1:
        found.append("light")
    if len({(row.x_um, row.y_um) for row in rows}) > 1 and "condenser" not in found:
        found.append("stage")
    if len({row.z_um for row in rows}) > 1:
        found.append("focus")
    scenes = {row.scene for row in rows}
    if EVEN in scenes:
        return _field_kind(file, found, report, is_mixed=len(scenes) > 1)
    if len(found) > 1:
        message = f"{' and '.join(found)} change from row to row"
        hint = "change one at a time, each series in a folder of its own"
        _wrong(file, report, message, hint)
        return None
    if not found and apertures != {None} and len({row.group for row in rows}) == 1:
        message = "condenser_aperture does not change"
        _wrong(file, report, message, "take two settings, or leave the column out")
        return None
    return found[0] if found else "still"


def _field_kind(
    file: Path, changed: Sequence[SeriesKind], report: Report, *, is_mixed: bool
) -> SeriesKind | None:
    """Return the kind of pictures of an even field; None, and MP905, if others are."""
    if not changed and not is_mixed:
        return "field"
    what = f"{changed[0]} changes" if changed else f"not all scenes are {EVEN}"
    hint = "nothing changes in a series of an even field; a folder of its own"
    _wrong(file, report, f"{what} beside an even field", hint)
    return None


def _all_there(file: Path, rows: Sequence[PictureReading], report: Report) -> bool:
    """Return whether rows have pictures, and pictures rows; else report it."""
    named = {row.name.partition("[")[0] for row in rows}
    held = {p.name for p in file.parent.iterdir() if p.is_file()} - {READINGS}
    held = {name for name in held if not name.startswith(".")}
    lost, unread = sorted(named - held), sorted(held - named)
    if lost:
        more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
        message = f"{lost[0]}{more} of the table is not in its folder"
        _wrong(file, report, message, "put it there, or take out its row")
    if unread:
        more = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
        message = f"{unread[0]}{more} has no readings"
        _wrong(file, report, message, "add a row, or put it elsewhere")
    return not lost and not unread


def readings_of_pages(
    readings: PictureReadings, intake: PictureIntake
) -> Iterator[tuple[PictureReading, PictureCounts]]:
    """Yield the pictures of a table with their rows; MP905 of those without one."""
    rows = readings.by_name
    for page in intake.pages(readings.files):
        row = rows.get(page.name)
        if row is None:
            message = f"{page.name} has no readings"
            _wrong(readings.file, intake.report, message, _PAGE)
            return
        yield row, page
    lost = [name for name in rows if name not in intake.met]
    if lost and not intake.report.failed:
        message = f"{lost[0]} is no picture of its file"
        _wrong(readings.file, intake.report, message, _PAGE)
