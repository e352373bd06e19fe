"""The summaries of run folders, read so that nothing but a run of the plan passes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microplan.executor.devices.errors import ExecutorError, why
from microplan.executor.record.plan_file import PlanFile

SUMMARY = "summary.json"
_MOST_BYTES = 1 << 26


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolderSummary:
    """One run folder's summary."""

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
        """Return what became of a step, None if the run did not do it."""
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
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ExecutorError(
                "MP879", f"{path} is larger than {_MOST_BYTES} bytes", place=path
            )
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExecutorError("MP879", f"{path}: {why(error)}", place=path) from error
    except (ValueError, RecursionError) as error:
        raise ExecutorError("MP879", f"{path}: {error}", place=path) from error
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
    if value is None:
        return True
    real = isinstance(value, int | float) and not isinstance(value, bool)
    try:
        return real and math.isfinite(value)
    except OverflowError:  # a whole number of more than 308 digits
        return False


def _same(run: RunFolderSummary) -> list[object]:
    """Return what tells a run from others: a simulated one is its seed."""
    found: list[object] = [run.folder.resolve()]
    if run.data.get("station") == "sim":
        found.append(f"seed {run.data.get('seed')} {run.data.get('faults')}")
    return found
