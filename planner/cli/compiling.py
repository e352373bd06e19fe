"""`microplan compile`: a task into a plan folder, compared with a golden plan."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import (
    BAD_INPUT,
    answer,
    asked_for,
    refuse,
)
from microplan.planner.cli.progress import Progress, kept_words
from microplan.planner.source.diagnostics import CallError, Report, Span
from microplan.schemas.page.console import tell

if TYPE_CHECKING:
    from microplan.planner.store.folder import PlanBytes


def compile_task(call: argparse.Namespace) -> int:
    """Compile a task into a plan folder."""
    if call.update and call.golden is None:
        tell("--update renews a golden plan: name it with --golden")
        return BAD_INPUT
    if call.preset == "sketch" and call.confidence is not None:
        tell("--confidence is shown by trials: a sketch has none")
        return BAD_INPUT
    report, said = Report(), ""
    timings: Mapping[str, float] = {}
    try:
        made = _compiled(call, report)
        if made is not None:
            timings = made[0].timings
            said = _written(call, *made, report)
    except CallError as error:
        refuse(call, report, error)
    status = answer(call, report, said)
    if call.timings and timings:
        from microplan.planner.store.summary import times_summary

        tell(times_summary(timings))  # last: notes would push them out of sight
    return status


def _written(
    call: argparse.Namespace, made: PlanBytes, folder: Path, report: Report
) -> str:
    """Return what to say of the plan that was written."""
    said = [made.summary, f"plan folder: {folder}"]
    if call.report:
        from microplan.planner.report.report import write_report

        said.append(f"report: {write_report(folder, None)}")
    if call.golden is not None:
        said.append(_golden(call, made, folder, report))
    return "\n".join(said)


def _compiled(
    call: argparse.Namespace, report: Report
) -> tuple[PlanBytes, Path] | None:
    """Return what a task compiles to and where it was written, None if at fault."""
    from microplan.planner.plan.cached_compile import compile_file
    from microplan.planner.plan.options import Options
    from microplan.planner.store.folder import check_folder, write_folder
    from microplan.planner.store.store import Store, place

    def ready(name: str) -> None:
        check_folder(call.out or _beside(call.task, name))
        if call.golden is not None:
            from microplan.planner.diff.diffing import check_golden, read_plan

            # what can be neither compared nor replaced need not be compiled for
            (check_golden if call.update else read_plan)(call.golden)

    store = None if call.no_cache else Store(call.cache or place())
    shown = Progress()
    options = asked_for(Options, call, progress=shown)
    try:
        files = compile_file(call.task, report, options, store, ready)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept_words(shown.last, store)) from None
    finally:
        shown.clear()
    if files is None:
        return None
    folder = call.out or _beside(call.task, files.name)
    write_folder(_with_findings(files, report, Path(call.task).parent), folder)
    return files, folder


def _with_findings(made: PlanBytes, report: Report, folder: Path) -> PlanBytes:
    """Return a plan folder with its findings; files are named as seen from `folder`."""
    from microplan.planner.store.folder import FINDINGS, json_bytes
    from microplan.schemas.codec import to_data

    found = []
    for each in report.in_order:
        here = re.compile(rf"(?<![^\s'\"(]){re.escape(str(folder))}/")
        file, message, hint = (
            here.sub("", text) for text in (each.where.file, each.message, each.hint)
        )
        where = replace(each.where, file=file)
        found.append(replace(each, where=where, message=message, hint=hint))
    data = json_bytes(to_data(tuple(found)))
    return replace(made, files={**made.files, FINDINGS: data})


def _beside(task: str, name: str) -> Path:
    """Return the plan folder of a task unless the user names another."""
    return Path(task).parent / f"{name}.plan"


def _golden(
    call: argparse.Namespace, made: PlanBytes, folder: Path, report: Report
) -> str:
    """Return how a new plan compares with the golden one, renewed if asked for."""
    from microplan.planner.diff.change_text import changes_text
    from microplan.planner.diff.diffing import diff_with_golden, plan_file, renew_golden

    golden: Path = call.golden
    if call.update:
        renew_golden(folder, golden)
        return f"golden plan: {golden}"
    found = diff_with_golden(made.plan(), folder, golden, call.tolerance)
    if found.changes:
        where = Span(file=str(plan_file(golden)))
        hint = "meant? compile again with --update"
        message = f"{len(found.changes)} differences from the golden plan"
        report.differ("MP710", where, message, hint)
    more = _asking_for_all(call, folder)
    return changes_text(found.changes, found.old, found.new, more=more)


def _asking_for_all(call: argparse.Namespace, folder: Path) -> str:
    """Return what shows every difference from the golden plan."""
    from microplan.planner.diff.diffing import has_pictures

    words = ["microplan", "diff", str(call.golden), str(folder), "--all"]
    words += [] if has_pictures(call.golden) else ["--no-images"]
    stated = ", with the same --tolerance" if call.tolerance else ""
    return f"{shlex.join(words)} shows them{stated}"
