"""The arguments of every command; nothing is loaded that --help does not need."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

from microplan.planner.cli.argument_values import (
    asked,
    confidence,
    count,
    kinds,
    setting,
    share,
)
from microplan.planner.cli.picture_arguments import add_calibrate, add_measure
from microplan.planner.diff.changes import KINDS
from microplan.planner.diff.tolerances import parse_rule
from microplan.planner.task.presets import ASKED, AXES, parse_vary
from microplan.schemas.files.json_schema import NAMES
from microplan.schemas.page.completion import SHELLS
from microplan.schemas.page.console import add_version

Run = Callable[[argparse.Namespace], int]

# the keys of `microplan.optics.transfer.models.MODELS`, which --help cannot load: it
# loads scipy
LAWS = "geometric, product, stokseth, hopkins, exact"

EPILOG = (
    "Exit status: 0 done, 1 understood but the answer is no, 2 the input or the call "
    "is at fault, 70 a bug in microplan."
)


def build_parser(runs: Mapping[str, Run]) -> argparse.ArgumentParser:
    """Return the parser of all commands; `run` of what it returns does the job."""
    parser = argparse.ArgumentParser(
        prog="microplan",
        description="Offline compiler for vision-guided microassembly.",
        epilog=EPILOG,
    )
    add_version(parser)
    parser.set_defaults(verbose=False)  # of the commands that read no task
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (add, says) in _COMMANDS.items():
        command = commands.add_parser(name, help=says)
        add(command)
        command.set_defaults(run=runs[name])
    return parser


def _add_task(parser: argparse.ArgumentParser) -> None:
    """Add what all commands share that read a task."""
    parser.add_argument("task", help="task.yaml")
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="list the notes that ask for nothing, too, a line each",
    )
    _add_format(parser)


def _add_tolerance(parser: argparse.ArgumentParser) -> None:
    """Add by how much values of two plans may differ."""
    parser.add_argument(
        "--tolerance",
        action="append",
        default=[],
        type=asked(parse_rule, "PATTERN=0.1, PATTERN=5% or PATTERN=ignore"),
        metavar="PATTERN=VALUE",
        help="0.1, 5%% or ignore, where a value's path ends as the pattern says: "
        "control/gain=5%%",
    )


def _add_format(parser: argparse.ArgumentParser) -> None:
    """Add how findings are written."""
    parser.add_argument(
        "--format",
        choices=("text", "json", "github", "sarif"),
        default="text",
        help="of the findings; default: text",
    )


def _add_jobs(parser: argparse.ArgumentParser, says: str) -> None:
    """Add the number of worker processes."""
    allowed = "a whole number from 1 to 256"
    parser.add_argument("--jobs", type=asked(count, allowed), default=1, help=says)


def _add_image_error(parser: argparse.ArgumentParser, says: str) -> None:
    """Add the error of images that is aimed at."""
    converted = asked(share, "a number above 0, at most 1")
    parser.add_argument("--max-image-error", type=converted, help=says)


def _add_cache(parser: argparse.ArgumentParser) -> None:
    """Add what is kept between compiles."""
    parser.add_argument("--no-cache", action="store_true", help="compute everything")
    parser.add_argument(
        "--cache",
        type=Path,
        metavar="FOLDER",
        help="what is kept between compiles; default: $XDG_CACHE_HOME/microplan",
    )


def _add_check(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan check`."""
    parser.add_argument("-o", "--out", type=Path, help="folder for a drawing a part")
    _add_task(parser)


def _add_compile(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan compile`."""
    parser.add_argument("-o", "--out", type=Path, help="default: <name>.plan beside it")
    _add_jobs(parser, "worker processes")
    _add_scheduler(parser)
    parser.add_argument(
        "--preset",
        choices=ASKED,
        help="how much to spend; sketch: pictures and findings without a trial",
    )
    parser.add_argument(
        "--confidence",
        type=asked(confidence, "a number from 0.5 to 0.9999"),
        metavar="C",
        help="that P(success) meets the goal, as 0.95: trials rise until its lower "
        "bound decides; default: P(success) alone must meet it",
    )
    _add_image_error(
        parser,
        "aimed at, of unit contrast: above 0, at most 1; default: the task's",
    )
    _add_cache(parser)
    parser.add_argument(
        "--golden", type=Path, metavar="PLAN", help="compare with this plan or folder"
    )
    parser.add_argument(
        "--timings",
        action="store_true",
        help="say on standard error what took how long",
    )
    parser.add_argument("--update", action="store_true", help="renew the golden plan")
    parser.add_argument(
        "--report", action="store_true", help="write report.html in the plan folder too"
    )
    _add_tolerance(parser)
    _add_task(parser)


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan sweep`."""
    parser.add_argument(
        "--set",
        action="append",
        required=True,
        type=asked(setting, "KEY=VALUE,VALUE,..."),
        dest="settings",
        metavar="KEY=VALUE,...",
        help="values of a key of the task, or below workcell of its workcell, as"
        " steps.ID.within_um=2,3; a row for each combination",
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        help="folder, whose rows are not made again; default: <name>.sweep beside it",
    )
    _add_jobs(parser, "worker processes")
    _add_scheduler(parser)
    _add_cache(parser)
    _add_task(parser)


def _add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Add the address of a cluster."""
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, in place of --jobs; whoever reaches it can run"
        " programs on its workers",
    )


def _add_render(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan render`."""
    parser.add_argument("--step", required=True, help="id of the step")
    parser.add_argument("--magnification", type=float, help="default: as compiled")
    parser.add_argument("--focus-um", type=float, help="world height in focus")
    parser.add_argument("--model", help=f"defocus law: {LAWS}; default: exact")
    _add_image_error(
        parser,
        "law and sampling that keep it at this focus, sampling alone with --model;"
        " with --trial as for compile",
    )
    parser.add_argument("--noise", action="store_true", help="add the sensor's noise")
    parser.add_argument("--trial", type=int, help="rebuild this trial of the benchmark")
    parser.add_argument("-o", "--out", type=Path, required=True, help=".png or .npy")
    _add_task(parser)


def _add_tradeoff(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan tradeoff`."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--step", help="id of the step; default: all that look")
    what.add_argument(
        "--vary",
        type=asked(parse_vary, f"{', '.join(AXES)}, each once, as trials=24:64"),
        metavar="AXIS,...",
        help="compile the whole task by preset, trials, frames, zoom, each with its "
        "usual values or those given: preset,trials=24:304",
    )
    _add_jobs(parser, "with --vary: processes")
    _add_image_error(
        parser,
        "what may be chosen; default: the task's",
    )
    parser.add_argument(
        "-o", "--out", type=Path, help="folder; default: <name>.tradeoff beside it"
    )
    _add_task(parser)


def _add_diff(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan diff`."""
    parser.add_argument("old", type=Path, help="plan.json, or the folder it is in")
    parser.add_argument("new", type=Path, help="plan.json, or the folder it is in")
    _add_tolerance(parser)
    parser.add_argument(
        "--fail-on",
        type=asked(kinds, f"worse, {', '.join(KINDS)}"),
        default=(),
        metavar="KIND,...",
        help=f"worse, {', '.join(KINDS)}; default: any difference",
    )
    parser.add_argument("--no-images", action="store_true", help="compare no pictures")
    parser.add_argument("--all", action="store_true", help="list every difference")
    _add_format(parser)


def _add_export(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan export`."""
    parser.add_argument("plan", type=Path, help="plan folder, or the plan.json in it")
    parser.add_argument(
        "--to",
        required=True,
        choices=("dxf", "json", "ome-tiff", "useq"),
        help="dxf, json: predicted outlines; ome-tiff: reference images; useq: "
        "positions and focus stacks",
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        required=True,
        help="dxf, ome-tiff: a folder; json: a file; useq: a .yaml or .json file",
    )
    parser.add_argument(
        "--look",
        action="append",
        default=[],
        metavar="ID",
        help="only this look; may be given several times",
    )
    parser.add_argument(
        "--channel", metavar="PRESET", help="useq: preset of the group Channel"
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace an older export"
    )
    _add_format(parser)


def _add_report(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan report`."""
    parser.add_argument("plan", type=Path, help="plan folder, or its plan.json")
    parser.add_argument(
        "-o", "--out", type=Path, help="file; default: report.html in the plan folder"
    )
    _add_format(parser)


def _add_explain(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan explain`."""
    parser.add_argument("code", nargs="?", help="as MP104; default: list all")


def _add_init(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan init`."""
    parser.add_argument("folder", type=Path, help="new, or without these files")


def _add_schema(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan schema`."""
    parser.add_argument("name", choices=NAMES, help="which file's")


def _add_completion(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan completion`."""
    parser.add_argument("shell", choices=SHELLS, help="whose script")


_COMMANDS: Mapping[str, tuple[Callable[[argparse.ArgumentParser], None], str]] = {
    "init": (_add_init, "write a task to begin with"),
    "check": (_add_check, "read, resolve and check a task"),
    "compile": (_add_compile, "compile a task into a plan"),
    "sweep": (_add_sweep, "compile a task with many values, into a table"),
    "render": (_add_render, "render what a step will see"),
    "tradeoff": (_add_tradeoff, "measure speed against accuracy"),
    "measure": (add_measure, "measure a target in pictures of it"),
    "calibrate": (add_calibrate, "find workcell lines in pictures of your own"),
    "diff": (_add_diff, "tell what changed between two plans"),
    "export": (_add_export, "write a plan's looks in another tool's format"),
    "report": (_add_report, "write a plan's report as one HTML page"),
    "explain": (_add_explain, "tell more about a finding"),
    "schema": (_add_schema, "print the schema of a format"),
    "completion": (_add_completion, "print a completion script for a shell"),
}
