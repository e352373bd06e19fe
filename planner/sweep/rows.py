"""One row of a sweep: a variant compiled, and the lines of the file that keeps it."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.open_queue import own_kind
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.store.folder import OutputError, not_written
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store
from microplan.planner.task.task import Task
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.plan import Plan, dump_plan

FORMAT_VERSION = 1
_BEGIN = b'{"format_version": 1, "key": "'
_HEAD = re.compile(rb'\{"format_version": \d+, "key": "')


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRow:
    """What one variant compiles to."""

    status: str  # of the plan; "error": there is none
    reason: str  # "" if feasible
    success_probability: float | None  # None: the plan ends before it is known
    success_lower: float | None  # its lower bound, 95 %
    worst_sigma_um: float | None  # of its looks' positions, per axis
    worst_look: str  # that has it; "" without looks
    plan_sha256: str  # of plan.json; "" without one
    cpu: str  # kind of the processor; another's results may differ in their last digits
    time_s: float


def compile_row(task: Task, store: Store | None) -> SweepRow:
    """Return the row of a variant, compiled in this process; a chunk of the queue."""
    started, report = time.perf_counter(), Report()
    files = compile_task(task, report, Options(memo=Memo(store)))
    if store is not None:
        store.trim()
    plan = None if files is None else files.plan
    return row_of(plan, report, time.perf_counter() - started)


def row_of(plan: Plan | None, report: Report, took_s: float) -> SweepRow:
    """Return the row of a plan, or of why there is none."""
    faults = [d for d in report.in_order if d.severity in ("error", "infeasible")]
    looks = [] if plan is None else [each for s in plan.steps for each in s.looks]
    worst = max(looks, key=lambda look: look.sigma_xy_um, default=None)
    complete = plan is not None and plan.success_probability > 0
    bound = None if plan is None else plan.success_bound
    digest = "" if plan is None else _sha256(dump_plan(plan))
    return SweepRow(
        status="error" if plan is None else plan.status,
        reason="; ".join(map(_said, faults)),
        success_probability=plan.success_probability if plan and complete else None,
        success_lower=bound.success_low if bound and complete else None,
        worst_sigma_um=None if worst is None else worst.sigma_xy_um,
        worst_look="" if worst is None else worst.id,
        plan_sha256=digest,
        cpu=own_kind().cpu,
        time_s=round(took_s, 3),
    )


def refused(report: Report) -> SweepRow:
    """Return the row of a combination that the task refuses."""
    return row_of(None, report, 0.0)


def broken(error: Exception) -> SweepRow:
    """Return the row of a variant whose compile ended with an error of its own."""
    reason = f"{type(error).__name__}: {error}"
    return replace(row_of(None, Report(), 0.0), reason=reason)


def _said(finding: Diagnostic) -> str:
    return f"{finding.code} {finding.message}"


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class RowFile:
    """Finished rows by their keys, a line of JSON each, added as they come.

    A line that was cut off, or is no row, counts as absent.
    """

    def __init__(self, file: Path) -> None:
        """Read a file, if there is one; MP701 if it is another program's."""
        self._file = file
        self.rows: dict[str, SweepRow] = dict(_read(file))

    def add(self, key: str, values: Mapping[str, Any], row: SweepRow) -> None:
        """Keep a row; MP702 if it cannot be written."""
        head = {"format_version": FORMAT_VERSION, "key": key, "set": values}
        line = json.dumps({**head, **asdict(row)}, ensure_ascii=False) + "\n"
        data = line.encode("utf-8", "backslashreplace")
        try:
            with self._file.open("a+b") as stream:
                size = stream.seek(0, 2)
                stream.seek(max(size - 1, 0))
                cut = stream.read(1) not in (b"", b"\n")
                stream.write((b"\n" if cut else b"") + data)
        except OSError as error:
            raise not_written(self._file, error) from error
        self.rows[key] = row


def _read(file: Path) -> Iterator[tuple[str, SweepRow]]:
    """Yield the whole rows of a file by their keys, none if there is no file.

    MP701 for a file in which no line begins as a row, not even one that was cut off.
    """
    try:
        lines = file.read_bytes().splitlines()
    except FileNotFoundError:
        return
    except OSError as error:
        raise not_written(file, error) from error
    lines = [line for line in lines if line]
    if lines and not any(map(_HEAD.match, lines)) and not _BEGIN.startswith(lines[-1]):
        raise foreign(file)
    for line in lines:
        try:
            data = json.loads(line)
            if data["format_version"] == FORMAT_VERSION:
                yield from_data(str, data["key"]), from_data(SweepRow, data)
        except (ValueError, KeyError, TypeError, CodecError, RecursionError):
            continue


def foreign(file: Path) -> OutputError:
    """Return MP701 for a file that a sweep would write, and that is no sweep's."""
    said = f"{file} is of no sweep of microplan; it is left untouched"
    return OutputError("MP701", said, file)
