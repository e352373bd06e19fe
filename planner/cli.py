"""The command microplan: one subcommand a job, findings in four forms."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from planner.arguments import build_parser
from planner.diagnostics import TITLES, Report, Span
from planner.terminal import in_colour, painted
from schemas.console import OutputLostError, flush, say, tell

if TYPE_CHECKING:
    from planner.inputs.task import Task
    from planner.outputs.emit import PlanFiles
    from schemas.plan import Plan

DONE, NO, BAD_INPUT, BUG = 0, 1, 2, 70
STOPPED = 130  # by Ctrl-C, as shells tell it


class Coded(Protocol):
    """An exception with the code of its finding."""

    code: str


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status of one call."""
    # One thread each: `--jobs` spreads work over processes, and sums keep their order.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        status = _status(argv)
        flush()
    except KeyboardInterrupt:
        tell("stopped")
        return STOPPED
    except OutputLostError as error:
        tell(f"error: {error}")
        return BAD_INPUT
    except Exception as error:  # the one place that catches everything
        tell(f"bug in microplan: {type(error).__name__}: {error}")
        if os.environ.get("MICROPLAN_TRACEBACK"):
            raise
        return BUG
    return status


def _status(argv: Sequence[str] | None) -> int:
    """Do what was asked for; return the exit status."""
    try:
        call = build_parser(_RUNS).parse_args(argv)
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for a wrong call
        return int(leaving.code or 0)
    status: int = call.run(call)
    return status


def _check(call: argparse.Namespace) -> int:
    """Read and check a task without rendering."""
    from planner.inputs.read_task import load_task
    from planner.model.check import check_task  # shapely, but no imaging and no scipy
    from planner.outputs.parts import parts_summary

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(call, report, "")
    said = [check_task(task, report), parts_summary(task.parts)]
    if call.out:
        from planner.outputs.drawn import write_drawings
        from planner.outputs.errors import OutputError

        try:
            said.append(write_drawings(task.parts, call.out))
        except OutputError as error:
            return _refuse(call, report, error)
    return _tell(call, report, "\n".join(said) if said[0] else "")


def _compile(call: argparse.Namespace) -> int:
    """Compile a task into a plan folder."""
    from planner.diffing import DiffError
    from planner.outputs.errors import OutputError
    from planner.outputs.summary import plan_summary, times_summary

    if call.watch:
        return _watch(call)
    report = Report()
    try:
        made = _compiled(call, report)
        if made is None:
            return _tell(call, report, "")
        files, folder = made
        said = f"{plan_summary(files.plan)}\nplan folder: {folder}"
        if call.report:
            from planner.reporting.report import write_report

            said += f"\nreport: {write_report(folder, None)}"
        if call.timings:
            tell(times_summary(files.timings))
        if call.golden is not None:
            said += "\n" + _golden(call, files.plan, folder, report)
    except OutputError as error:
        return _refuse(call, report, error)
    except DiffError as error:
        report.error(error.code, Span(file=error.file), str(error))
        return _tell(call, report, "")
    return _tell(call, report, said)


def _compiled(
    call: argparse.Namespace, report: Report
) -> tuple[PlanFiles, Path] | None:
    """Return what a task compiles to and where it was written, None if at fault."""
    from planner.caching.store import Store, place
    from planner.compiling import compile_file
    from planner.diffing import read_plan
    from planner.options import Options
    from planner.outputs.emit import check_folder, write_folder

    store = None if call.no_cache else Store(call.cache or place())
    options = Options(
        preset=call.preset,
        max_image_error=call.max_image_error,
        jobs=call.jobs,
        tell=_tell_step,
    )

    def ready(name: str) -> None:
        check_folder(call.out or _beside(call.task, name))
        if call.golden is not None and not call.update:
            read_plan(call.golden)  # what cannot be compared need not be compiled

    files = compile_file(call.task, report, options, store, ready)
    if files is None:
        return None
    folder = call.out or _beside(call.task, files.plan.name)
    write_folder(files, folder)
    return files, folder


def _watch(call: argparse.Namespace) -> int:
    """Compile whenever a file changes; only Ctrl-C or an unusable call ends it."""
    from planner.outputs.errors import OutputError
    from planner.outputs.findings import render_findings
    from planner.watching import last_plan, round_text, watch

    if call.golden is not None or call.update or call.format != "text":
        tell("--watch goes with neither --golden nor --format")
        return BAD_INPUT

    def compiled(report: Report) -> Plan | None:
        made = _compiled(call, report)
        return None if made is None else made[0].plan

    try:
        for found in watch(call.task, compiled, last_plan(call.out)):
            grave = [d for d in found.report.in_order if d.severity != "note"]
            _tell_findings(render_findings(grave, "", "text")[1])
            say(round_text(found, Path(call.task).parent))
    except OutputError as error:
        return _refuse(call, Report(), error)
    return DONE


def _beside(task: str, name: str) -> Path:
    """Return the plan folder of a task unless the user names another."""
    return Path(task).parent / f"{name}.plan"


def _golden(call: argparse.Namespace, plan: Plan, folder: Path, report: Report) -> str:
    """Return how a new plan compares with the golden one, renewed if asked for."""
    from planner.diffing import diff_with_golden, plan_file, renew_golden
    from planner.outputs.changes import changes_text

    golden: Path = call.golden
    if call.update:
        renew_golden(folder, golden)
        return f"golden plan: {golden}"
    changes = diff_with_golden(plan, folder, golden, call.tolerance)
    if changes:
        where = Span(file=str(plan_file(golden)))
        hint = "meant? compile again with --update"
        message = f"{len(changes)} differences from the golden plan"
        report.refuse("MP710", where, message, hint)
    return changes_text(changes)


def _render(call: argparse.Namespace) -> int:
    """Render one step's image to a file."""
    from planner.inputs.read_task import load_task
    from planner.preview import RenderCall, RenderError, render_step

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(call, report, "")
    try:
        said = render_step(
            task,
            RenderCall(
                step=call.step,
                magnification=call.magnification,
                focus_um=call.focus_um,
                model=call.model,
                max_image_error=call.max_image_error,
                noise=call.noise,
                trial=call.trial,
                out=call.out,
            ),
            report,
        )
    except RenderError as error:
        return _refuse(call, report, error)
    return _tell(call, report, said)


def _tradeoff(call: argparse.Namespace) -> int:
    """Measure time and error of every way to compute a task's images."""
    from planner.inputs.read_task import load_task
    from planner.outputs.errors import OutputError
    from planner.preview import RenderError
    from planner.tradeoff import TradeoffCall, write_tradeoff

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(call, report, "")
    if call.vary is not None:
        return _tradeoff_of_task(call, task, report)
    try:
        found = write_tradeoff(
            task,
            TradeoffCall(
                step=call.step,
                max_image_error=call.max_image_error,
                out=call.out or Path(call.task).parent / f"{task.name}.tradeoff",
            ),
            report,
            _progress,
        )
    except (OutputError, RenderError) as error:
        return _refuse(call, report, error)
    return _tell(call, report, found)


def _tradeoff_of_task(call: argparse.Namespace, task: Task, report: Report) -> int:
    """Compile a whole task in several ways."""
    from planner.outputs.errors import OutputError
    from planner.task_tradeoff import TaskCall, VaryError, write_task_tradeoff

    asked = TaskCall(
        vary=call.vary,
        jobs=call.jobs,
        max_image_error=call.max_image_error,
        out=call.out or Path(call.task).parent / f"{task.name}.tradeoff",
    )
    try:
        found = write_task_tradeoff(task, asked, _progress)
    except (OutputError, VaryError) as error:
        return _refuse(call, report, error)
    return _tell(call, report, found)


def _tell_step(done: int, count: int, step: str) -> None:
    """Say which step is being compiled, on a terminal only."""
    if sys.stderr.isatty():
        tell(f"compiling {step} ({done + 1} of {count}) ...")


def _progress(step: str) -> None:
    """Say what is being worked on, on a terminal only."""
    if sys.stderr.isatty():
        tell(f"measuring {step} ...")


def _diff(call: argparse.Namespace) -> int:
    """Compare two plans: 0 for the same, 1 for different."""
    from planner.diffing import DiffCall, DiffError, diff
    from planner.outputs.changes import changes_json, changes_text, findings_of

    try:
        found = diff(
            DiffCall(
                old=call.old,
                new=call.new,
                rules=call.tolerance,
                fail_on=call.fail_on,
                pictures=not call.no_images,
            )
        )
    except DiffError as error:
        report = Report()
        report.error(error.code, Span(file=error.file), str(error))
        return _tell(call, report, "")
    for note in found.notes:
        tell(f"note: {note}")
    if call.format in ("text", "json"):
        told = changes_text(found.changes, tell_all=call.all)
        if call.format == "json":
            told = changes_json(found.changes, str(call.old), str(call.new))
        say(told)
        return NO if found.failing else DONE
    report = Report(found=findings_of(found.changes, found.failing, str(call.new)))
    return _tell(call, report, f"{len(found.changes)} differences")


def _export(call: argparse.Namespace) -> int:
    """Write a plan's looks in another tool's format."""
    from planner.exporting.export import ExportCall, export
    from planner.exporting.folder import ExportError
    from planner.outputs.errors import OutputError

    report, said = Report(), ""
    try:
        said = export(
            ExportCall(
                plan=call.plan,
                to=call.to,
                out=call.out,
                looks=tuple(call.look),
                channel=call.channel,
                overwrite=call.overwrite,
            ),
            report,
        )
    except ExportError as error:
        report.error(error.code, Span(file=error.file), str(error), error.hint)
    except OutputError as error:
        report.error(error.code, Span(file=str(call.out)), str(error))
    return _tell(call, report, said)


def _report(call: argparse.Namespace) -> int:
    """Write the report of a plan folder."""
    from planner.diffing import DiffError
    from planner.outputs.errors import OutputError
    from planner.reporting.report import write_report

    report, said = Report(), ""
    try:
        said = f"report: {write_report(call.plan, call.out)}"
    except (DiffError, OutputError) as error:
        report.error(error.code, Span(file=str(call.plan)), str(error))
    return _tell(call, report, said)


def _explain(call: argparse.Namespace) -> int:
    """Print the page of a code, or all codes."""
    from planner.outputs.shipped import page

    if call.code is None:
        listed = (f"{code}  {title}" for code, title in TITLES.items())
        say("\n".join(listed))
        return DONE
    text = page(call.code)
    if text is None:
        tell(f"no code {call.code!r}; microplan explain lists all")
        return BAD_INPUT
    say(text.rstrip())
    return DONE


def _init(call: argparse.Namespace) -> int:
    """Write a task that compiles into a folder."""
    from planner.outputs.errors import OutputError
    from planner.outputs.starter import write_starter

    try:
        say(write_starter(call.folder))
    except OutputError as error:
        tell(f"error[{error.code}]: {error}")
        return BAD_INPUT
    return DONE


def _schema(call: argparse.Namespace) -> int:
    """Print a JSON Schema."""
    import json

    from schemas import load

    say(json.dumps(load(call.name), indent=2, ensure_ascii=False))
    return DONE


def _completion(call: argparse.Namespace) -> int:
    """Print a script that completes this command in a shell."""
    from planner.completion import script

    try:
        say(script(build_parser(_RUNS), call.shell).rstrip("\n"))
    except ImportError:
        tell("completion needs shtab: install microplan[completion]")
        return BAD_INPUT
    return DONE


def _migrate(call: argparse.Namespace) -> int:
    """Rewrite a task or workcell of an older format."""
    from planner.migrating import MigrateCall, migrate
    from planner.outputs.errors import OutputError

    report = Report()
    try:
        told = migrate(
            MigrateCall(file=call.task, out=call.out, in_place=call.in_place), report
        )
    except OutputError as error:
        return _refuse(call, report, error)
    if told is None:
        return _tell(call, report, "")
    tell(told.said)
    say(told.text.removesuffix("\n"))
    return DONE


def _refuse(call: argparse.Namespace, report: Report, error: Coded) -> int:
    """Tell what could not be done with the call itself, beside the findings."""
    report.error(error.code, Span(file=call.task), str(error))
    return _tell(call, report, "")


def _tell(call: argparse.Namespace, report: Report, result: str) -> int:
    """Print findings and result; return the exit status they amount to."""
    from planner.outputs.findings import render_findings

    out, err = render_findings(report.in_order, result, call.format)
    _tell_findings(err)
    say(out)
    if report.failed:
        return BAD_INPUT
    refused = any(d.severity == "infeasible" for d in report.found)
    return NO if refused else DONE


def _tell_findings(text: str) -> None:
    """Print findings, in colour where that is wanted."""
    tell(text, painted if in_colour(sys.stderr, os.environ) else None)


_RUNS = {
    "init": _init, "check": _check, "compile": _compile, "render": _render,
    "tradeoff": _tradeoff, "diff": _diff, "export": _export, "report": _report,
    "migrate": _migrate,
    "explain": _explain, "schema": _schema, "completion": _completion,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
