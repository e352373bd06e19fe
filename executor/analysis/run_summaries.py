"""Run summaries read from run folders: only runs of the plan pass."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.devices.station_file import is_file
from microplan.executor.record.frames import FOLDER, INDEX
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.run_folder import EVENTS, PLAN, SUMMARY
from microplan.schemas.codec import as_real
from microplan.schemas.folders import contents
from microplan.schemas.plan import Region

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
        """Return the result of each step that was begun."""
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
    """Return the artifacts of a run folder.

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


def measured_regions(folder: Path, look: str) -> Mapping[str, Region]:
    """Return which regions of a run's frames in a folder were measured for a look.

    By the names of files; what the index does not have whole is left out.
    """
    found = {}
    for row in _lines(folder / INDEX):
        values = reals(row, "measured")
        if text(row, "look") != look or len(values) != len(fields(Region)):
            continue
        row_px, column, rows, columns = map(round, values)
        region = Region(row=row_px, column=column, rows=rows, columns=columns)
        found[Path(text(row, "file")).name] = region
    return found


def real(row: Row, name: str) -> float | None:
    """Return a number of a row, None if it has none of that name that is sane."""
    number = as_real(row.get(name))
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
    lines = contents(path, _MOST_BYTES).splitlines()
    yield from filter(None, map(_object, lines))


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolderSummary:
    """Summary of one run folder."""

    folder: Path
    data: Mapping[str, Any]

    @property
    def apart(self) -> str:
        """Return why the run says nothing of its plan's predictions, "" if it does."""
        if self.data.get("faults"):
            return "its faults were asked for"
        if self.data.get("executors", 1) != 1:
            return "it was resumed: times begin anew"
        return ""

    def step(self, name: str) -> Mapping[str, Any] | None:
        """Return the result of a step, None if the run did not do it."""
        for row in self.data["steps"]:
            if row["id"] == name and row["code"] is None:
                found: Mapping[str, Any] = row
                return found
        return None


def read_runs(folders: Sequence[Path], file: PlanFile) -> tuple[RunFolderSummary, ...]:
    """Return the runs of some folders.

    Raises
    ------
    ExecutorError
        MP879 if one is no run of this plan, or the same as another.
    """
    runs = tuple(_read(folder, file) for folder in folders)
    seen: dict[object, Path] = {}
    for run in runs:
        for key in _same(run):
            if key in seen:
                raise ExecutorError(
                    "MP879", f"{run.folder} and {seen[key]} are the same run"
                )
            seen[key] = run.folder
    return runs


def _read(folder: Path, file: PlanFile) -> RunFolderSummary:
    """Return one run; MP879 if it is none of the plan."""
    path = folder / SUMMARY
    with failing("MP879", path, (OSError, ValueError, RecursionError)):
        if path.stat().st_size > _MOST_BYTES:
            raise ExecutorError(
                "MP879", f"{path} is larger than {_MOST_BYTES} bytes", place=path
            )
        data = json.loads(path.read_text(encoding="utf-8"))
    if not _is_summary(data):
        raise ExecutorError("MP879", f"{path} is no summary of a run", place=path)
    if data.get("plan_sha256") != file.sha256:
        raise ExecutorError(
            "MP879",
            f"{folder} is a run of another plan: {data.get('plan_sha256')}, this one's "
            f"hash is {file.sha256}",
        )
    return RunFolderSummary(folder=folder, data=data)


def _is_summary(data: Any) -> bool:
    """Return whether data have what is read of a summary."""
    return (
        isinstance(data, dict)
        and {"code", "done", "steps", "true_look_error_um"} <= set(data)
        and isinstance(data["steps"], list)
        and all(isinstance(s, dict) and {"id", "code"} <= set(s) for s in data["steps"])
        and all(_number(v) for s in data["steps"] for k, v in s.items() if k in _READ)
        and isinstance(data["true_look_error_um"], dict)
        and all(map(_number, data["true_look_error_um"].values()))
    )


_READ = ("cycles", "time_s", "error_um", "spread_um", "height_um", "limit_um",
         "expected_sigma_um")  # fmt: skip


def _number(value: Any) -> bool:
    """Return whether a value is a finite number or nothing."""
    return value is None or math.isfinite(as_real(value))


def _same(run: RunFolderSummary) -> list[object]:
    """Return the identities of a run; a simulated one is its seed."""
    found: list[object] = [run.folder.resolve()]
    if run.data.get("station") == "sim":
        found.append(f"seed {run.data.get('seed')} {run.data.get('faults')}")
    return found
