"""Subcommands that read a task and make no plan: check, render, tradeoff, sweep."""

from __future__ import annotations

import argparse
from pathlib import Path

from microplan.planner.cli.answering import answered, asked_for, tell_progress
from microplan.planner.source.diagnostics import Report
from microplan.schemas.page.console import say


@answered
def check(call: argparse.Namespace, report: Report) -> str:
    """Read and check a task without rendering."""
    from microplan.planner.task.part_summary import parts_summary
    from microplan.planner.task.read_task import load_task
    from microplan.planner.views.check_task import (
        check_task,  # shapely, but no imaging and no scipy
    )

    task = load_task(call.task, report)
    if task is None:
        return ""
    said = [check_task(task, report), parts_summary(task.parts)]
    if call.out:
        from microplan.planner.task.drawn import write_drawings

        said.append(write_drawings(task.parts, call.out))
    return "\n".join(said) if said[0] else ""


@answered
def render(call: argparse.Namespace, report: Report) -> str:
    """Render one step's image to a file."""
    from microplan.planner.task.read_task import load_task
    from microplan.planner.tradeoff.preview import RenderCall, render_step

    task = load_task(call.task, report)
    if task is None:
        return ""
    return render_step(task, asked_for(RenderCall, call), report)


@answered
def tradeoff(call: argparse.Namespace, report: Report) -> str:
    """Measure time and error of every method of computing a task's images."""
    from microplan.planner.task.read_task import load_task

    task = load_task(call.task, report)
    if task is None:
        return ""
    out = call.out or Path(call.task).parent / f"{task.name}.tradeoff"
    if call.vary is None:
        from microplan.planner.tradeoff.tradeoff import TradeoffCall, write_tradeoff

        asked = asked_for(TradeoffCall, call, out=out)
        return write_tradeoff(task, asked, report, _progress)
    from microplan.planner.tradeoff.task_tradeoff import TaskCall, write_task_tradeoff

    return write_task_tradeoff(task, asked_for(TaskCall, call, out=out), _progress)


@answered
def sweep(call: argparse.Namespace, report: Report) -> str:
    """Compile a task with every combination of values, into a table."""
    from microplan.planner.store.store import Store, place
    from microplan.planner.sweep.sweeping import SweepCall, write_sweep

    store = None if call.no_cache else Store(call.cache or place())
    show = say if call.format == "text" else tell_progress
    asked = asked_for(SweepCall, call, store=store, show=show, progress=tell_progress)
    return write_sweep(call.task, asked, report)


def _progress(step: str) -> None:
    """Say what is being measured."""
    tell_progress(f"measuring {step} ...")
