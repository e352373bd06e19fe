"""The command microplan: one subcommand a job, findings in four forms."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from microplan.planner.cli.answering import BAD_INPUT, DONE
from microplan.planner.cli.arguments import build_parser
from microplan.planner.cli.calibrating import calibrate
from microplan.planner.cli.compiling import compile_task
from microplan.planner.cli.measuring import measure
from microplan.planner.cli.plans import diff, export, report_plan
from microplan.planner.cli.shipped import codes, explain, init, schema
from microplan.planner.cli.tasks import check, render, sweep, tradeoff
from microplan.schemas.page.console import OutputLostError, flush, say, tell

BUG = 70
STOPPED = 130  # by Ctrl-C, as shells report it
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


# what is no more -> what to use instead; said for this version
_RETIRED = {
    ("migrate",): "there is no 'migrate': no older format exists; 'microplan check' "
    "says what is to be changed in a file",
    (
        "compile",
        "--watch",
    ): "there is no '--watch': have your editor, or a watcher such "
    "as watchexec or entr, call 'microplan compile'; unchanged steps come from the "
    "cache",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status of one call."""
    # One thread each: `--jobs` spreads work over processes, and sums keep their order.
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    try:
        status = _status(argv)
        flush()
    except KeyboardInterrupt as stop:
        tell("; ".join(["stopped", *stop.args]))
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
    parser = build_parser(_RUNS)
    words = sys.argv[1:] if argv is None else argv
    for retired, instead in _RETIRED.items():
        if tuple(words[:1]) == retired[:1] and set(retired) <= set(words):
            tell(instead)
            return BAD_INPUT
    if not words:
        tell(parser.format_help().rstrip("\n"))  # what can be asked for
        return BAD_INPUT
    try:
        call = parser.parse_args(argv)
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for a wrong call
        return int(leaving.code or 0)
    status: int = call.run(call)
    return status


def _completion(call: argparse.Namespace) -> int:
    """Print a script that completes this command in a shell."""
    from microplan.schemas.page.completion import script

    parser = build_parser(_RUNS)
    try:
        say(script(parser, call.shell, {"code": codes()}).rstrip("\n"))
    except ImportError:
        tell("completion needs shtab: install microplan[completion]")
        return BAD_INPUT
    return DONE


_RUNS = {
    "init": init, "check": check, "compile": compile_task, "render": render,
    "sweep": sweep, "tradeoff": tradeoff, "measure": measure,
    "calibrate": calibrate, "diff": diff, "export": export, "report": report_plan,
    "explain": explain, "schema": schema, "completion": _completion,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
