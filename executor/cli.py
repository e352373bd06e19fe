"""The command microplan-run: read a plan, run it on a station, say how it went."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executor.artifacts import Artifacts
from executor.beliefs import Beliefs
from executor.errors import BUG, CODES, DONE, ExecutorError
from executor.frames import Frames
from executor.journal import Journal
from executor.motion import Motion
from executor.operator import Operator
from executor.past import Header
from executor.resume import begin, take_up
from executor.rig import Rig
from executor.run import RunResult, run_plan
from executor.run_folder import (
    EVENTS,
    SUMMARY,
    RunFolder,
    check_free,
    check_same,
    lock_beside,
    new_run,
    old_run,
    sha256,
)
from executor.simulated.faults import FAULTS
from executor.site import SIMULATED, Site, find_site
from executor.station import preflight
from executor.summary import summary_json, table
from schemas.codec import CodecError, to_data
from schemas.plan import Measure, Plan, VerifyAction, parse_plan

if TYPE_CHECKING:
    from executor.simulated.cell import Cell
    from executor.simulated.judging import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class _Call:
    """What was asked for on the command line."""

    plan_file: Path
    station: str
    seed: int | None  # None: 0, or that of the run that is resumed
    mode: str
    run_dir: Path | None
    frames: bool
    faults: tuple[str, ...]
    resume: bool
    discard: bool

    @property
    def folder(self) -> Path:
        """Return the plan folder."""
        return self.plan_file.parent

    @property
    def station_file(self) -> Path | None:
        """Return the station's file, None for the simulated cell."""
        return None if self.station == SIMULATED else Path(self.station)


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status: 0 done, 1 no, 2 input, 3 machine, 4 stopped, 70 a bug."""
    try:
        call = _parse(argv)
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


def _parse(argv: Sequence[str] | None) -> _Call:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog="microplan-run",
        description="Run an augmented plan on a station.",
        epilog="Exit status: 0 done, 1 the answer is no, 2 input or call at fault, "
        "3 machine trouble, 4 stopped, 70 a bug.",
    )
    parser.add_argument("plan", type=Path, help="plan.json, or the folder it is in")
    parser.add_argument(
        "--station", required=True, help="sim: the simulated cell; or a station.toml"
    )
    parser.add_argument(
        "--seed", type=seed_number, help="of the simulated cell; default: 0"
    )
    parser.add_argument(
        "--mode",
        choices=["run", "check", "dry-run"],
        default="run",
        help="check: read and compare only; dry-run: list what would be done",
    )
    parser.add_argument("--run-dir", type=Path, help="default: <plan name>.run beside")
    parser.add_argument(
        "--resume", action="store_true", help="go on with the run of the run folder"
    )
    parser.add_argument(
        "--discard", action="store_true", help="throw away a run that did not end"
    )
    parser.add_argument("--no-frames", action="store_true", help="keep no images")
    parser.add_argument(
        "--inject",
        action="append",
        default=[],
        metavar="FAULT[@STEP]",
        help="a simulated fault, from the start on or in one step: "
        + ", ".join(FAULTS),
    )
    found = parser.parse_args(argv)
    if found.resume and (found.discard or found.mode != "run"):
        parser.error("--resume goes with neither --discard nor another --mode than run")
    return _Call(
        plan_file=found.plan / "plan.json" if found.plan.is_dir() else found.plan,
        station=found.station,
        seed=found.seed,
        mode=found.mode,
        run_dir=found.run_dir,
        frames=not found.no_frames,
        faults=tuple(found.inject),
        resume=found.resume,
        discard=found.discard,
    )


def seed_number(text: str) -> int:
    """Return a seed, a whole number from 0 on."""
    value = int(text)
    if value < 0:
        raise ValueError("a seed is not negative")
    return value


def _run(call: _Call) -> int:
    """Do what was asked; errors are the caller's to report."""
    plan = _read_plan(call.plan_file)
    path = call.run_dir or call.folder.parent / f"{plan.name}.run"
    with ExitStack() as stack:
        if call.station_file is not None and call.station_file.is_file():
            stack.enter_context(lock_beside(call.station_file))
        if call.mode == "run" and call.resume:
            return _resume(call, plan, stack.enter_context(old_run(path)))
        if call.mode == "run":
            check_free(path, discard=call.discard)
        site = _site(call, call.seed or 0, call.faults, None)
        preflight(plan, site.station)
        artifacts = Artifacts.from_folder(plan, call.folder)
        if call.mode == "check":
            _say(f"{plan.name}: {len(plan.steps)} steps fit the station")
            return DONE
        if call.mode == "dry-run":
            _say("\n".join(_listing(plan)))
            return DONE
        run = stack.enter_context(new_run(path, discard=call.discard))
        run.begin(call.plan_file, call.station_file)
        return _perform(call, plan, site, artifacts, run)


def _resume(call: _Call, plan: Plan, run: RunFolder) -> int:
    """Go on with the run of a folder."""
    then = run.header
    seed = then.seed if call.seed is None else call.seed
    faults = call.faults or then.faults
    call = replace(call, seed=seed, faults=faults)
    check_same(_header(call, then.devices), then)  # before a driver is touched
    site = _site(call, seed, faults, run.cell)
    check_same(_header(call, site.station.devices()), then)
    preflight(plan, site.station, begun=True)
    artifacts = Artifacts.from_folder(plan, call.folder)
    return _perform(call, plan, site, artifacts, run)


def _site(call: _Call, seed: int, faults: tuple[str, ...], left: Path | None) -> Site:
    """Return the station that was asked for."""
    return find_site(call.station, call.folder, seed=seed, faults=faults, left=left)


def _header(call: _Call, devices: Mapping[str, str]) -> Header:
    """Return what a run is begun with."""
    file = call.station_file
    return Header(
        plan_sha256=sha256(call.plan_file),
        station=SIMULATED if file is None else sha256(file),
        seed=call.seed or 0,
        faults=call.faults,
        devices=devices,
    )


def _perform(
    call: _Call, plan: Plan, site: Site, artifacts: Artifacts, run: RunFolder
) -> int:
    """Run the plan, write the run folder and print the outcome."""
    folder, station, seq = run.path, site.station, run.last_event()
    with (
        (folder / EVENTS).open("a", encoding="utf-8", newline="\n") as stream,
        run.intents() as intents,
        Operator(_asker()) as operator,
    ):
        rig = Rig(
            plan=plan,
            station=station,
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=artifacts,
            journal=Journal(stream, station.clock, seq=seq),
            frames=Frames(folder / "frames" if call.frames else None),
            motion=Motion(operator.pause),
            intents=intents,
        )
        errors = _watch(rig, site.cell)
        if site.cell is not None and call.station_file is None:
            keep_world(site.cell, run.cell)
        try:
            if run.found is None:
                begin(rig, _header(call, station.devices()))
            else:
                take_up(rig, run.found.past, _question())
            result = run_plan(rig)
        except KeyboardInterrupt:
            left = "; ".join(rig.motion.stop(station)) or "nothing moves any more"
            rig.journal.write("stopped", why=left)
            raise ExecutorError("MP860", f"stopped; {left}") from None
        except BaseException:  # a bug must not leave anything in motion either
            rig.motion.stop(station)
            raise
    verdict = None if site.cell is None else _verdict(plan, site.cell)
    _write_summary(folder, call, site, plan, result, verdict, errors)
    _say(table(result, errors))
    return _report(call, plan, result, verdict, folder)


def keep_world(cell: Cell, path: Path) -> None:
    """Have a simulated cell keep its world beside the journal."""
    from executor.simulated.keeping import keep  # optics only for the simulated cell

    try:
        keep(cell, path)
    except OSError as error:
        raise ExecutorError("MP863", f"{path}: {error}") from error


def _watch(rig: Rig, cell: Cell | None) -> dict[str, float]:
    """Return a record, filled while the rig runs: step -> its last look's true error.

    Only a simulated cell knows the truth; a plan never sees it.
    """
    errors: dict[str, float] = {}
    if cell is None:
        return errors
    shown_um = cell.shown_um

    def note(target: str, x_um: float, y_um: float) -> None:
        owner, offset = rig.beliefs.anchor(target)
        true_x, true_y = shown_um(owner, *offset)
        errors[rig.journal.step] = math.hypot(x_um - true_x, y_um - true_y)

    rig.watch, rig.on_step = note, cell.faults.enter
    return errors


def _report(
    call: _Call, plan: Plan, result: RunResult, verdict: Verdict | None, folder: Path
) -> int:
    """Print findings and verdicts; return the exit status."""
    _say(f"run folder: {folder}")
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


def _write_summary(
    folder: Path,
    call: _Call,
    site: Site,
    plan: Plan,
    result: RunResult,
    verdict: Verdict | None,
    errors: dict[str, float],
) -> None:
    """Write summary.json and the table."""
    extra: dict[str, Any] = {
        "station": site.name,
        "seed": call.seed or 0,
        "faults": list(call.faults),
        "cell_verdict": None if verdict is None else to_data(verdict),
        "true_look_error_um": to_data(errors),
    }
    text = summary_json(plan, result, extra)
    try:
        words = table(result, errors) + "\n"
        (folder / "summary.txt").write_text(words, encoding="utf-8")
        (folder / SUMMARY).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExecutorError(
            "MP863", f"the run has ended; its summary: {error}"
        ) from error


def _verdict(plan: Plan, cell: Cell) -> Verdict | None:
    """Return what truly became of what the last verify step is about."""
    checks = [s.action for s in plan.steps if isinstance(s.action, VerifyAction)]
    if not checks or checks[-1].target.partition(".")[0] not in cell.truth.bodies:
        return None
    last = checks[-1]
    return cell.judge(last.target, last.on, last.within_um, last.within_rad)


def _read_plan(path: Path) -> Plan:
    """Return the plan, or raise MP802."""
    try:
        return parse_plan(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExecutorError("MP802", f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, CodecError) as error:
        words = str(error)
        if path.suffix in (".yaml", ".yml"):
            words = f"{path} is a task, no plan: compile it first (microplan compile)"
        raise ExecutorError("MP802", words) from error


def _asker() -> Callable[[], bool] | None:
    """Return how to ask the operator, None if nobody sits there."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None

    def ask() -> bool:
        print("paused: Enter goes on, q stops, Ctrl-C stops at once", file=sys.stderr)
        return sys.stdin.readline() == "\n"  # "" is the end of the input: nobody there

    return ask


def _question() -> Callable[[str], bool] | None:
    """Return how to put a question to the operator, None if nobody sits there."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None

    def ask(question: str) -> bool:
        print(f"{question} y goes on, anything else stops", file=sys.stderr)
        return sys.stdin.readline().strip() == "y"

    return ask


def _listing(plan: Plan) -> list[str]:
    """Return one line for every move, look and action of the plan."""
    lines = []
    for step in plan.steps:
        lines.append(f"{step.id}: {step.verb}")
        lines += [f"  move {_targets(to_data(move))}" for move in step.moves]
        lines += [
            f"  look at {look.target} at {look.view.magnification:g} x, focus "
            f"{look.view.focus_um:g} um: {'; '.join(map(_found_by, look.measures))}"
            for look in step.looks
        ]
    return lines


def _found_by(measure: Measure) -> str:
    """Return the routines that find a feature, and which, if it is not the target."""
    names = ", ".join(use.id for use in measure.chain)
    return f"{names} on {measure.feature}" if measure.feature else names


def _targets(move: dict[str, Any]) -> str:
    """Return the axes a move names, with their values."""
    axes = move.pop("axes")
    return " ".join(f"{axes}.{k}={v:g}" for k, v in move.items() if v is not None)


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
