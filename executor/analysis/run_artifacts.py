"""What a run left in its folder, read for its report; what is torn is left out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.paths import is_file
from microplan.executor.record.frames import FOLDER, INDEX
from microplan.executor.record.run_folder import EVENTS, PLAN, SUMMARY
from microplan.schemas.folders import contents

_MOST_BYTES = 1 << 26  # of a file of lines
_MOST = 1e100  # of a number: no device measures more, and no chart could show it

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunArtifacts:
    """A run's plan, summary, events and frames."""

    folder: Path
    plan: Row  # of plan.json, as far as it is read
    plan_sha256: str
    summary: Row  # {} if the run did not end
    events: Sequence[Row]
    frames: Sequence[Row]  # lines of the index, in order

    @property
    def steps(self) -> list[Row]:
        """Return what became of each step that was begun."""
        found = self.summary.get("steps")
        rows = found if isinstance(found, list) else []
        return [row for row in rows if isinstance(row, dict) and "id" in row]

    def of(self, event: str, step: str | None = None) -> list[Row]:
        """Return the events of one kind, those of one step if it is named."""
        return [
            row
            for row in self.events
            if row.get("event") == event and step in (None, row.get("step"))
        ]


def read_left(folder: Path) -> RunArtifacts:
    """Return what a run left.

    Raises
    ------
    ExecutorError
        MP879 if the folder holds no run.
    """
    if not is_file(folder / EVENTS):
        raise ExecutorError(
            "MP879", f"{folder} holds no run: it has no {EVENTS}", place=folder
        )
    source = contents(folder / PLAN, _MOST_BYTES)
    return RunArtifacts(
        folder=folder,
        plan=_object(source),
        plan_sha256=hashlib.sha256(source).hexdigest(),
        summary=_object(contents(folder / SUMMARY, _MOST_BYTES)),
        events=tuple(_lines(folder / EVENTS)),
        frames=tuple(_lines(folder / FOLDER / INDEX)),
    )


def real(row: Row, name: str) -> float | None:
    """Return a number of a row, None if it has none of that name that is sane."""
    value = row.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return None
    return number if abs(number) < _MOST else None  # nan is not below either


def reals(row: Row, name: str) -> list[float]:
    """Return a list of numbers of a row, [] if it is none."""
    values = row.get(name)
    if not isinstance(values, list):
        return []
    found = [real({"value": value}, "value") for value in values]
    return [value for value in found if value is not None]


def text(row: Row, name: str) -> str:
    """Return a text of a row, "" if it has none of that name."""
    value = row.get(name)
    return value if isinstance(value, str) else ""


def _object(data: bytes) -> Row:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _lines(path: Path) -> Iterator[Row]:
    """Yield the objects of a file of lines."""
    for line in contents(path, _MOST_BYTES).splitlines():
        found = _object(line)
        if found:
            yield found
