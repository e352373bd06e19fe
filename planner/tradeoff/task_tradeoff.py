"""Tradeoff of speed against accuracy of a whole task, for `tradeoff --vary`."""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from microplan.planner.diff.compare import compare_plans
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.folder import write_files
from microplan.planner.store.memo import EVERY_TIME
from microplan.planner.task.presets import Vary
from microplan.planner.task.task import Task
from microplan.planner.tradeoff.render_methods import front
from microplan.planner.tradeoff.task_axes import CompileMethod, compile_methods
from microplan.planner.tradeoff.task_plots import task_png
from microplan.planner.tradeoff.task_tradeoff_record import (
    Spent,
    TaskTradeoff,
    TradeoffPoint,
    points_csv,
    points_table,
)
from microplan.planner.tradeoff.tradeoff_record import json_text
from microplan.schemas.files.times import spans
from microplan.schemas.plan import Plan, Step

FORMAT_VERSION = "1.0"
NOTE = (
    "Every point differs from the first in one thing. Frames are what averaging would "
    "give: the executor takes one. Chances and errors are the plan's own predictions."
)
CHOICES = ("chain", "magnification", "method", "others")  # ends of paths of a plan


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskCall:
    """What to vary, and where to write it."""

    vary: Vary
    jobs: int
    max_image_error: float | None  # None: the task's, or the preset's
    out: Path


class VaryError(CallError):
    """A value that cannot be; carries the code of its finding."""


def write_task_tradeoff(
    task: Task, call: TaskCall, progress: Callable[[str], None]
) -> str:
    """Compile a task by several methods, write the folder, and return a table.

    Nothing is kept between points, so that each takes what it takes alone.

    Parameters
    ----------
    task : Task
        The task.
    call : TaskCall
        What to vary.
    progress : callable
        Receives the name of what is being compiled.

    Raises
    ------
    VaryError
        MP404 if a value cannot be.
    OutputError
        MP702 if the folder cannot be written.
    """
    try:
        wanted = compile_methods(task, call.vary)
    except ValueError as error:
        raise VaryError("MP404", str(error)) from error
    write_files(call.out, {})  # before minutes are spent
    points: list[TradeoffPoint] = []
    spent: list[Spent] = []
    first, said = None, ""
    for k, method in enumerate(wanted):
        progress(f"{method.varied} ({k + 1} of {len(wanted)})")
        plan, report, took = compiled(task, method, call)
        points.append(point_of(method, plan, report, first))
        spent.append(took)
        first = plan if k == 0 else first
        said = _write_points(
            task, call.out, points, spent
        )  # what is done outlives a stop
    return f"{said}\n\nfolder: {call.out}"


def _write_points(
    task: Task, folder: Path, points: Sequence[TradeoffPoint], spent: Sequence[Spent]
) -> str:
    """Write the points so far, and return their table."""
    found, times = with_fronts(points, spent)
    record = TaskTradeoff(
        format_version=FORMAT_VERSION, task=task.name, note=NOTE, points=found
    )
    spent_by = {"machine": _machine(), "points": times}
    write_files(
        folder,
        {
            "task.csv": points_csv(record).encode(),
            "task.json": json_text(record).encode(),
            "task-times.json": json_text(spent_by, digits=3).encode(),
            "task.png": task_png(record, times),
        },
    )
    return points_table(record, times)


def compiled(
    task: Task, method: CompileMethod, call: TaskCall
) -> tuple[Plan | None, Report, Spent]:
    """Return the plan of a point, None with findings if there is none, and its time."""
    report, cpu_s, wall_s = Report(), _cpu_s(), time.perf_counter()
    files = compile_task(
        method.of(task),
        report,
        Options(
            preset=method.preset,
            effort=method.effort,
            max_image_error=call.max_image_error,
            jobs=call.jobs,
            memo=EVERY_TIME,
        ),
    )
    took = Spent(
        varied=method.varied,
        cpu_s=_cpu_s() - cpu_s,
        wall_s=time.perf_counter() - wall_s,
        on_front=False,
    )
    return None if files is None else files.plan, report, took


def point_of(
    method: CompileMethod, plan: Plan | None, report: Report, first: Plan | None
) -> TradeoffPoint:
    """Return what a plan promises, or why there is none."""
    faults = [d for d in report.in_order if d.severity in ("error", "infeasible")]
    complete = plan is not None and plan.success_probability > 0
    return TradeoffPoint(
        varied=method.varied,
        preset=method.preset,
        trials=method.effort.trials,
        frames=method.frames,
        zoom=method.zoom,
        status="error" if plan is None else plan.status,
        reason="; ".join(f"{d.code} {d.message}" for d in faults),
        error_um=error_um(plan) if plan is not None and complete else None,
        success_probability=plan.success_probability if plan and complete else None,
        success_lower=success_lower(plan) if plan and complete else None,
        run_s=run_s(plan) if plan is not None and complete else None,
        choices=None if plan is None or first is None else choices(first, plan),
        on_front=False,
    )


def error_um(plan: Plan) -> float | None:
    """Return where the last insertion or placement ends: one sigma per axis, um.

    The root of the sum of squares of the budget's terms, a term along one direction
    counted half. Without a mechanical action that of the last look; None without one.
    """
    for step in reversed(plan.steps):
        if step.verb == "insert" or step.placing is not None:
            return _spread_um(step)
    looks = [look for step in plan.steps for look in step.looks]
    return looks[-1].sigma_xy_um if looks else None


def _spread_um(step: Step) -> float:
    squares = [
        (row.sigma_um or 0.0) ** 2 * (1.0 if row.along_rad is None else 0.5)
        for row in step.budget.rows
        if not row.term.startswith("size of ")  # of the room, not of the position
    ]
    return math.sqrt(sum(squares))


def success_lower(plan: Plan) -> float | None:
    """Return the lower bound of the probability of success, None where unknown."""
    return None if plan.success_bound is None else plan.success_bound.success_low


def run_s(plan: Plan) -> float:
    """Return what looks and alignments take, s: zoom, focus, frames, corrections."""
    return sum(span.total_s for span in spans(plan, None))


def choices(first: Plan, plan: Plan) -> tuple[str, ...]:
    """Return the choices that differ between two plans, as `microplan diff` says."""
    found_choices = []
    for change in compare_plans(first, plan):
        if change.kind == "steps":
            found_choices.append(f"{change.where}: {change.says}")
        elif change.path[-1] in CHOICES and "evidence" not in change.path:
            step = change.path[1] if len(change.path) > 1 else ""
            found_choices.append(f"{step} {change.path[-1]}: {change.says}")
    return tuple(dict.fromkeys(found_choices))


def with_fronts(
    points: Sequence[TradeoffPoint], spent: Sequence[Spent]
) -> tuple[tuple[TradeoffPoint, ...], tuple[Spent, ...]]:
    """Return both with what is on the fronts of run time and of compile time."""
    running = front([(p.run_s, p.error_um) for p in points])
    making = front([(s.cpu_s, p.error_um) for s, p in zip(spent, points, strict=True)])
    return (
        tuple(replace(p, on_front=k in running) for k, p in enumerate(points)),
        tuple(replace(s, on_front=k in making) for k, s in enumerate(spent)),
    )


def _cpu_s() -> float:
    """Return the CPU time of this process and of those it waited for."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}, microplan {version('microplan')}"
