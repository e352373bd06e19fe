"""Subcommands that read a task and make no plan: check, render, tradeoff."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import answer, refuse, tell_progress
from microplan.planner.source.diagnostics import Report

if TYPE_CHECKING:
    from microplan.planner.task.task import Task
    from microplan.planner.tradeoff.preview import RenderCall


def check(call: argparse.Namespace) -> int:
    """Read and check a task without rendering."""
    from microplan.planner.task.part_summary import parts_summary
    from microplan.planner.task.read_task import load_task
    from microplan.planner.views.check_task import (
        check_task,  # shapely, but no imaging and no scipy
    )

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return answer(call, report, "")
    said = [check_task(task, report), parts_summary(task.parts)]
    if call.out:
        from microplan.planner.store.folder import OutputError
        from microplan.planner.task.drawn import write_drawings

        try:
            said.append(write_drawings(task.parts, call.out))
        except OutputError as error:
            return refuse(call, report, error)
    return answer(call, report, "\n".join(said) if said[0] else "")


def render(call: argparse.Namespace) -> int:
    """Render one step's image to a file."""
    from microplan.planner.store.folder import OutputError
    from microplan.planner.task.read_task import load_task
    from microplan.planner.tradeoff.preview import RenderError, render_step

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return answer(call, report, "")
    try:
        said = render_step(task, _render_call(call), report)
    except (RenderError, OutputError) as error:
        return refuse(call, report, error)
    return answer(call, report, said)


def _render_call(call: argparse.Namespace) -> RenderCall:
    """Return which image is asked for."""
    from microplan.planner.tradeoff.preview import RenderCall

    return RenderCall(
        step=call.step,
        magnification=call.magnification,
        focus_um=call.focus_um,
        model=call.model,
        max_image_error=call.max_image_error,
        noise=call.noise,
        trial=call.trial,
        out=call.out,
    )


def tradeoff(call: argparse.Namespace) -> int:
    """Measure time and error of every way to compute a task's images."""
    from microplan.planner.task.read_task import load_task

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return answer(call, report, "")
    if call.vary is None:
        return _tradeoff_of_images(call, task, report)
    return _tradeoff_of_task(call, task, report)


def _tradeoff_of_images(call: argparse.Namespace, task: Task, report: Report) -> int:
    """Render the images of steps in several ways."""
    from microplan.planner.store.folder import OutputError
    from microplan.planner.tradeoff.preview import RenderError
    from microplan.planner.tradeoff.tradeoff import TradeoffCall, write_tradeoff

    asked = TradeoffCall(
        step=call.step,
        max_image_error=call.max_image_error,
        out=_tradeoff_folder(call, task),
    )
    try:
        found = write_tradeoff(task, asked, report, _progress)
    except (OutputError, RenderError) as error:
        return refuse(call, report, error)
    return answer(call, report, found)


def _tradeoff_of_task(call: argparse.Namespace, task: Task, report: Report) -> int:
    """Compile a whole task in several ways."""
    from microplan.planner.store.folder import OutputError
    from microplan.planner.tradeoff.task_tradeoff import (
        TaskCall,
        VaryError,
        write_task_tradeoff,
    )

    asked = TaskCall(
        vary=call.vary,
        jobs=call.jobs,
        max_image_error=call.max_image_error,
        out=_tradeoff_folder(call, task),
    )
    try:
        found = write_task_tradeoff(task, asked, _progress)
    except (OutputError, VaryError) as error:
        return refuse(call, report, error)
    return answer(call, report, found)


def _tradeoff_folder(call: argparse.Namespace, task: Task) -> Path:
    """Return where the comparison is written."""
    return call.out or Path(call.task).parent / f"{task.name}.tradeoff"


def _progress(step: str) -> None:
    """Say what is being measured."""
    tell_progress(f"measuring {step} ...")
