"""A sweep from its settings to its folder; what is finished outlives a stop."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from functools import partial
from os.path import relpath
from pathlib import Path

from microplan.planner.plan.open_queue import OtherVersionError, opened, own_kind
from microplan.planner.queue.work_queue import QueueLostError, WorkQueue
from microplan.planner.queue.workers import StoppedError
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import write_files
from microplan.planner.store.memo import digest
from microplan.planner.store.store import Store
from microplan.planner.sweep.checks import check_table, check_values
from microplan.planner.sweep.rows import (
    RowFile,
    SweepRow,
    broken,
    compile_row,
    refused,
)
from microplan.planner.sweep.table import SweepLines, csv_text
from microplan.planner.sweep.variants import (
    SweepError,
    Variant,
    changes,
    settings,
    variants,
)
from microplan.planner.task.read_task import load_task

ROWS, TABLE = "rows.jsonl", "sweep.csv"
_AHEAD = 512  # rows that are read and handed over before their turn


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepCall:
    """What the command line asks for."""

    settings: Sequence[tuple[str, str]]  # keys, and their values as written
    out: Path | None = None  # None: named by the task, beside it
    jobs: int = 1
    scheduler: str | None = None
    store: Store | None = None
    show: Callable[[str], None] = lambda _line: None  # receives the lines of the table
    progress: Callable[[str], None] = lambda _text: None


@dataclass(slots=True)
class _Sweep:
    """A sweep under way."""

    task: str
    call: SweepCall
    files: dict[str, str]  # that variants read -> sha256
    folder: Path
    lines: SweepLines
    kept: RowFile
    found: dict[int, tuple[Variant, SweepRow]] = field(default_factory=dict)
    unkept: set[int] = field(default_factory=set)  # rows to be made again next time
    _inputs: tuple[tuple[str, str], ...] = field(init=False)

    def __post_init__(self) -> None:
        folder = Path(self.task).parent
        files = sorted((relpath(k, folder), v) for k, v in self.files.items())
        self._inputs = tuple(files)

    def key(self, variant: Variant) -> str:
        """Return the key of a row: another one for other inputs, options, sources."""
        return digest("sweep", self._inputs, json.dumps(dict(variant.values)))

    def show(self, variant: Variant, row: SweepRow) -> None:
        """Show a row."""
        self.call.show(self.lines.line(variant, row))

    def take(self, variant: Variant, row: SweepRow) -> None:
        """Keep a row that was made, and show it."""
        if variant.row not in self.unkept:
            self.kept.add(self.key(variant), dict(variant.values), row)
        self.found[variant.row] = (variant, row)
        self.show(variant, row)


def write_sweep(task: str, call: SweepCall, report: Report) -> str:
    """Compile all variants of a task file; return what to say of it at the end.

    Rows that the folder has of the same inputs are not made again.

    Raises
    ------
    CallError
        MP730 for settings that cannot be and for files that change meanwhile, MP731 for
        a scheduler, MP701 and MP702 for the folder.
    """
    asked = settings(call.settings)
    name = check_values(task, asked, report)
    if report.failed:
        return ""
    folder = call.out or Path(task).parent / f"{name}.sweep"
    write_files(folder, {})  # before minutes are spent
    check_table(folder / TABLE)
    todo = variants(asked)
    sweep = _Sweep(
        task=task,
        call=call,
        files=dict(report.files),
        folder=folder,
        lines=SweepLines(asked, len(todo)),
        kept=RowFile(folder / ROWS),
    )
    try:
        _run(sweep, todo)
    finally:
        if sweep.found:
            table = csv_text(sweep.found, own_kind().cpu)
            data = table.encode("utf-8", "backslashreplace")
            write_files(folder, {TABLE: data})
    return _summary(sweep)


def _run(sweep: _Sweep, todo: Sequence[Variant]) -> None:
    """Show the rows that are kept, make those that lack, and show them."""
    kept = sweep.kept.rows
    known = ((v, kept[k]) for v in todo if (k := sweep.key(v)) in kept)
    sweep.found.update((variant.row, (variant, row)) for variant, row in known)
    lacking = [variant for variant in todo if variant.row not in sweep.found]
    call = sweep.call
    scheduler = call.scheduler if lacking else None  # nobody is asked for nothing
    with opened(min(call.jobs, max(len(lacking), 1)), scheduler) as queue:
        call.show(sweep.lines.head)  # once it is known that there are workers
        for variant, row in sweep.found.values():
            sweep.show(variant, row)
        started = time.monotonic()
        for done, (variant, row) in enumerate(_made(sweep, lacking, queue), 1):
            sweep.take(variant, row)
            left_s = (time.monotonic() - started) / done * (len(lacking) - done)
            call.progress(f"{done} of {len(lacking)} rows, {_duration(left_s)} left")


def _made(
    sweep: _Sweep, todo: Sequence[Variant], queue: WorkQueue | None
) -> Iterator[tuple[Variant, SweepRow]]:
    """Yield rows as they come."""
    if queue is None:
        for variant in todo:
            yield variant, _result(sweep, variant, _chunk(sweep, variant))
        return
    rest, waiting = list(reversed(todo)), dict[Future[SweepRow], Variant]()
    while rest or waiting:
        may_add = bool(rest) and len(waiting) < _AHEAD
        if may_add:
            variant = rest.pop()
            handle = queue.submit(_chunk(sweep, variant), -float(variant.row))
            waiting[handle] = variant
        pause_s = 0.0 if may_add else None  # reading the next variants goes on
        done, _ = wait(waiting, pause_s, return_when=FIRST_COMPLETED)
        for handle in sorted(done, key=lambda each: waiting[each].row):
            variant = waiting.pop(handle)
            yield variant, _result(sweep, variant, handle.result)


def _result(
    sweep: _Sweep, variant: Variant, result: Callable[[], SweepRow]
) -> SweepRow:
    """Return the row that a chunk comes to; one that an error ended is not kept."""
    try:
        return result()
    except (QueueLostError, OtherVersionError, StoppedError):
        raise  # no row's own
    except Exception as error:  # noqa: BLE001 - the other rows can be made
        sweep.unkept.add(variant.row)
        return broken(error)


def _chunk(sweep: _Sweep, variant: Variant) -> Callable[[], SweepRow]:
    """Return what makes a row; values that are refused together need no worker.

    SweepError if a file is no longer what the keys of rows say.
    """
    report = Report()
    task = load_task(sweep.task, report, changes(variant))
    for file in sorted(report.sought):
        known = sweep.files.get(file)
        if known is None:  # no value alone asks for it: the key does not tell of it
            sweep.unkept.add(variant.row)
        elif known != report.files.get(file):
            raise SweepError(f"{file} changed while it was swept", "call again")
    if task is None:
        return partial(refused, report)
    return partial(compile_row, task, sweep.call.store)


def _summary(sweep: _Sweep) -> str:
    """Return how many rows there are of each status, and where they are."""
    rows = [row for _, row in sweep.found.values()]
    states = sorted({row.status for row in rows})
    counts = ", ".join(f"{sum(r.status == s for r in rows)} {s}" for s in states)
    others = sum(row.cpu != own_kind().cpu for row in rows)
    made = f"\n{others} made by another kind of processor: see cpu" if others else ""
    return f"{len(rows)} rows: {counts}{made}\nfolder: {sweep.folder}"


def _duration(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
