"""The command microplan: one subcommand a job, findings in four forms."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TextIO

from planner.arguments import build_parser
from planner.diagnostics import TITLES, Report, Span

if TYPE_CHECKING:
    from schemas.plan import Plan

DONE, NO, BAD_INPUT, BUG = 0, 1, 2, 70
# all control characters but tabs and line ends, and those that turn text round
_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


class Coded(Protocol):
    """An exception with the code of its finding."""

    code: str


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status of one call."""
    # One thread each: `--jobs` spreads work over processes, and sums keep their order.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        call = build_parser(_RUNS).parse_args(argv)
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for a wrong call
        return int(leaving.code or 0)
    try:
        status: int = call.run(call)
    except Exception as error:  # the one place that catches everything
        print(f"bug in microplan: {type(error).__name__}: {error}", file=sys.stderr)
        if os.environ.get("MICROPLAN_TRACEBACK"):
            raise
        return BUG
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
    from planner.caching.store import Store, place
    from planner.compiling import compile_file
    from planner.diffing import DiffError, read_plan
    from planner.options import Options
    from planner.outputs.emit import check_folder, write_folder
    from planner.outputs.errors import OutputError
    from planner.outputs.summary import plan_summary, times_summary

    report = Report()
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

    try:
        files = compile_file(call.task, report, options, store, ready)
        if files is None:
            return _tell(call, report, "")
        folder = call.out or _beside(call.task, files.plan.name)
        write_folder(files, folder)
        said = f"{plan_summary(files.plan)}\nplan folder: {folder}"
        if call.timings:
            _say(times_summary(files.timings), sys.stderr)
        if call.golden is not None:
            said += "\n" + _golden(call, files.plan, folder, report)
    except OutputError as error:
        return _refuse(call, report, error)
    except DiffError as error:
        report.error(error.code, Span(file=error.file), str(error))
        return _tell(call, report, "")
    return _tell(call, report, said)


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


def _tell_step(done: int, count: int, step: str) -> None:
    """Say which step is being compiled, on a terminal only."""
    if sys.stderr.isatty():
        print(f"compiling {step} ({done + 1} of {count}) ...", file=sys.stderr)


def _progress(step: str) -> None:
    """Say what is being worked on, on a terminal only."""
    if sys.stderr.isatty():
        print(f"measuring {step} ...", file=sys.stderr)


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
    if call.format in ("text", "json"):
        told = changes_text(found.changes, tell_all=call.all)
        if call.format == "json":
            told = changes_json(found.changes, str(call.old), str(call.new))
        _say(told, sys.stdout)
        return NO if found.failing else DONE
    report = Report(found=findings_of(found.changes, found.failing, str(call.new)))
    return _tell(call, report, f"{len(found.changes)} differences")


def _explain(call: argparse.Namespace) -> int:
    """Print the page of a code, or all codes."""
    from planner.outputs.shipped import page

    if call.code is None:
        listed = (f"{code}  {title}" for code, title in TITLES.items())
        _say("\n".join(listed), sys.stdout)
        return DONE
    text = page(call.code)
    if text is None:
        _say(f"no code {call.code!r}; microplan explain lists all", sys.stderr)
        return BAD_INPUT
    _say(text.rstrip(), sys.stdout)
    return DONE


def _init(call: argparse.Namespace) -> int:
    """Write a task that compiles into a folder."""
    from planner.outputs.errors import OutputError
    from planner.outputs.starter import write_starter

    try:
        _say(write_starter(call.folder), sys.stdout)
    except OutputError as error:
        _say(f"error[{error.code}]: {error}", sys.stderr)
        return BAD_INPUT
    return DONE


def _schema(call: argparse.Namespace) -> int:
    """Print a JSON Schema."""
    import json

    from schemas import load

    _say(json.dumps(load(call.name), indent=2, ensure_ascii=False), sys.stdout)
    return DONE


def _refuse(call: argparse.Namespace, report: Report, error: Coded) -> int:
    """Tell what could not be done with the call itself, beside the findings."""
    report.error(error.code, Span(file=call.task), str(error))
    return _tell(call, report, "")


def _tell(call: argparse.Namespace, report: Report, result: str) -> int:
    """Print findings and result; return the exit status they amount to."""
    from planner.outputs.findings import render_findings

    out, err = render_findings(report.in_order, result, call.format)
    _say(err, sys.stderr)
    _say(out, sys.stdout)
    if report.failed:
        return BAD_INPUT
    refused = any(d.severity == "infeasible" for d in report.found)
    return NO if refused else DONE


def _say(text: str, stream: TextIO) -> None:
    """Print text, if any; a reader that has left, as `head` does, is no fault.

    Names in files may hold what a terminal obeys, or what its encoding does not have.
    """
    if not text:
        return
    text = _CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
    encoding = stream.encoding or "utf-8"
    text = text.encode(encoding, "backslashreplace").decode(encoding)
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:  # what the interpreter flushes at its end goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


_RUNS = {
    "init": _init, "check": _check, "compile": _compile, "render": _render,
    "tradeoff": _tradeoff, "diff": _diff, "explain": _explain, "schema": _schema,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
