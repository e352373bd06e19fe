"""The command microplan-run: read a plan, run it on a station, say how it went."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from executor.artifacts import Artifacts
from executor.asked import Call, parse
from executor.errors import BUG, CODES, DONE, ExecutorError
from executor.listing import plan_lines
from executor.plan_file import read_plan
from executor.site import find_site
from executor.station import preflight
from executor.summary import table
from executor.whole_run import Ended, perform
from schemas.plan import Plan


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status: 0 done, 1 no, 2 input, 3 machine, 4 stopped, 70 a bug."""
    try:
        call = parse(argv)
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for a wrong call
        return int(leaving.code or 0)
    try:
        return _run(call)
    except ExecutorError as error:
        _tell(error, call.plan_file)
        return error.exit_status
    except KeyboardInterrupt:
        stopped = ExecutorError("MP860", "stopped before the run began")
        _tell(stopped, call.plan_file)
        return stopped.exit_status
    except Exception as error:  # the one place that catches everything
        print(f"bug in microplan: {type(error).__name__}: {error}", file=sys.stderr)
        return BUG


def _run(call: Call) -> int:
    """Do what was asked; errors are the caller's to report."""
    file = read_plan(call.plan_file)
    plan = file.plan
    site = find_site(call.station, call.folder, seed=call.seed, faults=call.faults)
    preflight(plan, site.station)
    artifacts = Artifacts.from_folder(plan, call.folder)
    if call.mode == "check":
        _say(f"{plan.name}: {len(plan.steps)} steps fit the station")
        return DONE
    if call.mode == "dry-run":
        _say("\n".join(plan_lines(plan)))
        return DONE
    return _report(call, plan, perform(call, file, site, artifacts, _asker()))


def _report(call: Call, plan: Plan, ended: Ended) -> int:
    """Print table, findings and verdicts; return the exit status."""
    result, verdict = ended.result, ended.verdict
    _say(table(result, ended.errors_um))
    _say(f"run folder: {ended.folder}")
    if verdict is not None:
        truly = "seated" if verdict.success else "not seated"
        _say(
            f"the cell's own verdict: {truly}, offset {verdict.offset_um:.3g} um, "
            f"height {verdict.height_um:.3g} um"
            + (f", {verdict.collided}" if verdict.collided else "")
            + (", still held" if verdict.held else "")
        )
    if result.code is None:
        _say(f"{plan.name}: done in {result.time_s:.1f} s")
        return DONE
    where = f"step {result.step}: " if result.step else ""
    _tell(ExecutorError(result.code, where + result.message), call.plan_file)
    _say(f"{plan.name}: failed")
    return CODES[result.code][1]


def _asker() -> Callable[[], bool] | None:
    """Return how to ask the operator, None if nobody sits there."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None

    def ask() -> bool:
        print("paused: Enter goes on, q stops, Ctrl-C stops at once", file=sys.stderr)
        return sys.stdin.readline() == "\n"  # "" is the end of the input: nobody there

    return ask


def _say(text: str) -> None:
    """Print text; a reader that has left, as `head` does, is no fault."""
    try:
        print(text, flush=True)
    except BrokenPipeError:  # what the interpreter flushes at its end goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(error: ExecutorError, plan_file: Path) -> None:
    """Print a finding."""
    print(f"error[{error.code}]: {error.message}", file=sys.stderr)
    print(f"  --> {plan_file}", file=sys.stderr)
    print(f"   = {CODES[error.code][0]}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
