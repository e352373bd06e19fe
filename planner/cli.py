"""The command microplan: check, compile and render a task."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from planner.diagnostics import Report, render_text
from planner.presets import PRESETS

DONE, NO, BAD_INPUT, BUG = 0, 1, 2, 70
# the keys of `optics.models.MODELS`, which --help cannot load: it loads scipy
LAWS = "geometric, product, stokseth, hopkins, exact"

EPILOG = (
    "Exit status: 0 done, 1 understood but the answer is no, 2 the input or the call "
    "is at fault, 70 a bug in microplan."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status of one call."""
    # One thread each: `--jobs` spreads work over processes, and sums keep their order.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        call = _parser().parse_args(argv)
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


def _parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="microplan",
        description="Offline compiler for vision-guided microassembly.",
        epilog=EPILOG,
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_check(commands.add_parser("check", help="read, resolve and check a task"))
    _add_compile(commands.add_parser("compile", help="compile a task into a plan"))
    _add_render(commands.add_parser("render", help="render what a step will see"))
    _add_tradeoff(
        commands.add_parser("tradeoff", help="measure speed against accuracy")
    )
    return parser


def _add_check(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan check`."""
    parser.add_argument("task", help="task.yaml")
    parser.set_defaults(run=_check)


def _add_compile(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan compile`."""
    parser.add_argument("task", help="task.yaml")
    parser.add_argument("-o", "--out", type=Path, help="default: <name>.plan beside it")
    parser.add_argument("--jobs", type=count, default=1, help="worker processes")
    parser.add_argument("--preset", choices=sorted(PRESETS), help="how much to spend")
    parser.add_argument(
        "--max-image-error", type=share, help="of unit contrast, above 0 and below 1"
    )
    parser.set_defaults(run=_compile)


def _add_render(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan render`."""
    parser.add_argument("task", help="task.yaml")
    parser.add_argument("--step", required=True, help="id of the step")
    parser.add_argument("--magnification", type=float, help="default: as compiled")
    parser.add_argument("--focus-um", type=float, help="world height in focus")
    parser.add_argument("--model", help=f"defocus law: {LAWS}; default: exact")
    parser.add_argument(
        "--max-image-error",
        type=share,
        help="law and sampling that keep it at this focus, sampling alone with --model;"
        " with --trial as for compile",
    )
    parser.add_argument("--noise", action="store_true", help="add the sensor's noise")
    parser.add_argument("--trial", type=int, help="rebuild this trial of the benchmark")
    parser.add_argument("-o", "--out", type=Path, required=True, help=".png or .npy")
    parser.set_defaults(run=_render)


def _add_tradeoff(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan tradeoff`."""
    parser.add_argument("task", help="task.yaml")
    parser.add_argument("--step", help="id of the step; default: all that look")
    parser.add_argument(
        "--max-image-error", type=share, help="what may be chosen; default: the task's"
    )
    parser.add_argument(
        "-o", "--out", type=Path, help="folder; default: <name>.tradeoff beside it"
    )
    parser.set_defaults(run=_tradeoff)


def _check(call: argparse.Namespace) -> int:
    """Read and check a task without rendering."""
    from planner.inputs.read_task import load_task
    from planner.model.check import check_task  # shapely, but no imaging and no scipy

    report = Report()
    task = load_task(call.task, report)
    summary = "" if task is None else check_task(task, report)
    return _tell(report, summary)


def _compile(call: argparse.Namespace) -> int:
    """Compile a task into a plan folder."""
    from planner.compiler import Options, compile_task
    from planner.inputs.read_task import load_task
    from planner.outputs.emit import OutputError, check_folder, write_folder
    from planner.outputs.summary import plan_summary

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(report, "")
    folder: Path = call.out or Path(call.task).parent / f"{task.name}.plan"
    try:
        check_folder(folder)
        files = compile_task(
            task,
            report,
            Options(
                preset=call.preset,
                max_image_error=call.max_image_error,
                jobs=call.jobs,
            ),
        )
        if files is None:
            return _tell(report, "")
        write_folder(files, folder)
    except OutputError as error:
        print(f"error[{error.code}]: {error}", file=sys.stderr)
        return BAD_INPUT
    return _tell(report, f"{plan_summary(files.plan)}\nplan folder: {folder}")


def _render(call: argparse.Namespace) -> int:
    """Render one step's image to a file."""
    from planner.inputs.read_task import load_task
    from planner.preview import RenderCall, RenderError, render_step

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(report, "")
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
        print(f"error[{error.code}]: {error}", file=sys.stderr)
        return BAD_INPUT
    return _tell(report, said)


def _tradeoff(call: argparse.Namespace) -> int:
    """Measure time and error of every way to compute a task's images."""
    from planner.inputs.read_task import load_task
    from planner.outputs.emit import OutputError
    from planner.preview import RenderError
    from planner.tradeoff import TradeoffCall, write_tradeoff

    report = Report()
    task = load_task(call.task, report)
    if task is None:
        return _tell(report, "")
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
        print(f"error[{error.code}]: {error}", file=sys.stderr)
        return BAD_INPUT
    return _tell(report, found)


def _progress(step: str) -> None:
    """Say what is being worked on, on a terminal only."""
    if sys.stderr.isatty():
        print(f"measuring {step} ...", file=sys.stderr)


def _tell(report: Report, result: str) -> int:
    """Print findings and result; return the exit status they amount to."""
    for finding in report.in_order:
        print(render_text(finding), file=sys.stderr)
    if result:
        print(result)
    if report.failed:
        return BAD_INPUT
    refused = any(d.severity == "infeasible" for d in report.found)
    return NO if refused else DONE


def count(text: str) -> int:
    """Return a whole number from 1 on."""
    value = int(text)
    if not 1 <= value <= 256:
        raise ValueError(text)
    return value


def share(text: str) -> float:
    """Return a number above 0 and below 1."""
    value = float(text)
    if not 0 < value < 1:
        raise ValueError(text)
    return value


if __name__ == "__main__":
    sys.exit(main())
