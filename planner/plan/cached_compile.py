"""Compilation of a task file by the cache where nothing has changed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import PlanBytes
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store
from microplan.planner.store.whole import Whole, remember, remembered

_PASSING = frozenset({"MP227", "MP731"})  # findings that another try may not have


def compile_file(
    task: str,
    report: Report,
    options: Options,
    store: Store | None,
    ready: Callable[[str], None],
) -> PlanBytes | None:
    """Return the plan folder of a task file, None if the file is at fault.

    Parameters
    ----------
    task : str
        The task file, as the user names it.
    report : Report
        Receives the findings.
    options : Options
        What the command line overrides; its `memo` is that of `store`.
    store : Store or None
        Where results are kept; None: everything is computed.
    ready : callable
        Gets the task's name before the work begins; it may raise.
    """
    started = time.perf_counter()
    asked = (options.preset, options.max_image_error, options.confidence)
    whole = None if store is None else remembered(store, task, asked)
    if whole is not None and isinstance(whole.made, PlanBytes):
        report.found.extend(whole.findings)
        report.files.update(whole.files)
        ready(whole.made.name)
        spent = {"total_s": time.perf_counter() - started}
        return replace(whole.made, timings=spent)
    # what nothing is computed for need not be loaded: that takes ten times as long
    from microplan.planner.plan.compiler import compile_task
    from microplan.planner.plan.emit import plan_bytes
    from microplan.planner.task.read_task import load_task

    read = load_task(task, report)
    if read is None:
        return None
    ready(read.name)
    files = compile_task(read, report, replace(options, memo=Memo(store)))
    if files is None:
        return None
    made = plan_bytes(files)
    if store is not None:
        _remember(store, task, asked, report, made)
    return made


def _remember(
    store: Store,
    task: str,
    asked: tuple[str | None, float | None, float | None],
    report: Report,
    made: PlanBytes,
) -> None:
    """Keep a compile, unless a second try may find something else."""
    if not _PASSING & {finding.code for finding in report.found}:
        whole = Whole(files=report.files, findings=tuple(report.found), made=made)
        remember(store, task, asked, whole)
    store.trim()
