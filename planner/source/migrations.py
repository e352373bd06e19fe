"""Files of an older format rewritten as the newest, comments and layout kept.

A change of a format that old files do not fit raises its version (`NEWEST` in
`microplan.planner.source.schema`) and adds a `Migration` to `MIGRATIONS`.
`docs/formats.md` says what raises a version and what does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import NEWEST, show
from microplan.planner.source.source import BREAK, Source, parse, read_text

Kind = Literal["task", "workcell"]

VERSION_KEYS: dict[str, Kind] = {"microplan": "task", "microplan_workcell": "workcell"}


@dataclass(frozen=True, slots=True)
class Edit:
    """What to write in the place of one key or value."""

    at: Span
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Migration:
    """One step of a format: a file of version `since` becomes one of `since` + 1."""

    kind: Kind
    since: int
    says: str  # what changed, for the user
    edits: Callable[[Source], Sequence[Edit]]  # the version itself is not among them


MIGRATIONS: tuple[Migration, ...] = ()  # version 1 is the first of both formats


@dataclass(frozen=True, slots=True, kw_only=True)
class Migrated:
    """A file in the newest version, and what was changed."""

    text: str
    version: int  # that it had
    says: tuple[str, ...]  # () if it was the newest


def migrated(
    path: Path,
    file: str,
    report: Report,
    *,
    table: Sequence[Migration] = MIGRATIONS,
    newest: int = NEWEST,
) -> Migrated | None:
    """Return a task or workcell file in the newest version.

    Only keys and values that changed their meaning are rewritten; comments, order and
    layout stay. Whether the file is otherwise in order is not judged.

    Parameters
    ----------
    path, file : Path, str
        The file, and its name as the user knows it.
    report : Report
        Receives why there is no result: MP001 to MP013, MP102, MP105.
    table, newest
        The steps known, and the version to reach.
    """
    text = read_text(path, file, report, Span(file=file))
    source = None if text is None else parse(text, path, file, report)
    if text is None or source is None or report.failed:
        return None
    key = _version_key(source, report)
    if key is None:
        return None
    first = version = source.data[key]
    if not _reaches(source, key, table, newest, report):
        return None
    says = []
    while version < newest:
        step = _step(table, VERSION_KEYS[key], version)
        edits = [*step.edits(source), Edit(source.value(key), str(version + 1))]
        text = edited(text, edits)
        source = parse(text, path, file, report)
        if source is None or source.get(key) != version + 1:
            raise ValueError(f"the step from version {version} leaves no such file")
        version += 1
        says.append(f"version {version}: {step.says}")
    return Migrated(text=text, version=first, says=tuple(says))


def edited(text: str, edits: Sequence[Edit]) -> str:
    """Return `text` with other words in some places, which must not overlap.

    Raises
    ------
    ValueError
        If two edits overlap.
    """
    starts = [0, *(found.end() for found in BREAK.finditer(text))]
    last = len(text)
    for edit in sorted(edits, key=lambda e: (e.at.line, e.at.column), reverse=True):
        start = starts[edit.at.line - 1] + edit.at.column - 1
        end = start + edit.at.length
        if end > last:
            raise ValueError(f"edits overlap in line {edit.at.line}")
        text, last = text[:start] + edit.text + text[end:], start
    return text


def is_older(kind: str, version: object, table: Sequence[Migration]) -> bool:
    """Return whether files of a version are read after a migration."""
    return any(step.kind == kind and step.since == version for step in table)


def _version_key(source: Source, report: Report) -> str | None:
    """Return the key that holds the file's version; report a file that has none."""
    found = [key for key in VERSION_KEYS if key in source.mapping()]
    if len(found) == 1:
        return found[0]
    report.error(
        "MP102",
        source.value(),
        f"one of the keys {' and '.join(VERSION_KEYS)} is needed, to tell the version",
        "name a task or a workcell file",
    )
    return None


def _reaches(
    source: Source,
    key: str,
    table: Sequence[Migration],
    newest: int,
    report: Report,
) -> bool:
    """Return whether steps lead to the newest version; report if none do."""
    version, at = source.data[key], source.value(key)
    if isinstance(version, int | float) and version > newest:
        message = f"{key} is {version}, this microplan reads version {newest}"
        report.error("MP013", at, message, "update microplan")
        return False
    whole = isinstance(version, int) and not isinstance(version, bool)
    if whole and version >= 0:
        steps = range(version, newest)
        if all(is_older(VERSION_KEYS[key], v, table) for v in steps):
            return True
    known = [str(s.since) for s in table if s.kind == VERSION_KEYS[key]]
    report.error(
        "MP105",
        at,
        f"{key} must be {' or '.join([*known, str(newest)])}, got {show(version)}",
    )
    return False


def _step(table: Sequence[Migration], kind: Kind, version: int) -> Migration:
    return next(s for s in table if s.kind == kind and s.since == version)
