"""A whole run: the plan on a site, its run folder, and what became of it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

from executor.artifacts import Artifacts
from executor.asked import Call
from executor.beliefs import Beliefs
from executor.errors import ExecutorError
from executor.frames import Frames
from executor.journal import ESCAPED, Journal
from executor.motion import Motion
from executor.operator import Operator
from executor.past import Header
from executor.plan_file import PlanFile
from executor.recording import CALLS, RESUMES, Record
from executor.resume import begin, take_up
from executor.rig import Rig
from executor.run import RunResult, run_plan
from executor.run_folder import EVENTS, FRESH, SUMMARY, RunFolder
from executor.site import SIMULATED, Site
from executor.station import Station
from executor.summary import summary_json, table
from schemas.codec import to_data
from schemas.plan import Plan, VerifyAction

if TYPE_CHECKING:
    from executor.simulated.cell import Cell
    from executor.simulated.judging import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a run ended; a simulated cell knows what truly became of it."""

    folder: Path
    result: RunResult
    verdict: Verdict | None
    errors_um: dict[str, float]  # step -> true error of its last look
    executors: int = 1  # that worked on it: more than one if it was resumed


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """What the operator can be asked; None where nobody sits there."""

    pause: Callable[[], bool] | None = None  # whether to go on after Ctrl-C
    question: Callable[[str], bool] | None = None  # whether to go on after a crash
    gate: Callable[[str], None] | None = None  # see `Rig.gate`
    progress: Callable[[str], None] | None = None  # told of every step that begins


def perform(
    call: Call,
    file: PlanFile,
    site: Site,
    artifacts: Artifacts,
    run: RunFolder,
    asking: Asking,
) -> Ended:
    """Run the plan, or what is left of it, and write the run folder.

    Parameters
    ----------
    call : Call
        What was asked for.
    file : PlanFile
        The plan.
    site : Site
        Where it runs.
    artifacts : Artifacts
        The plan's routines.
    run : RunFolder
        The locked folder, emptied for a new run.
    asking : Asking
        What the operator can be asked.

    Raises
    ------
    ExecutorError
        MP860 if the run is interrupted; MP863 if something cannot be written; codes of
        `executor.resume.take_up`.
    """
    station, seq = site.station, run.last_event()
    before = run.executors
    tag = f"_by{before + 1}" if before else ""
    frames = Frames(run.path if call.frames else None, tag=tag)
    calls = run.path / (f"calls-{before + 1}.jsonl" if before else CALLS)
    with (
        _open(run.path / EVENTS, "a") as stream,
        run.intents() as intents,
        _recorded(calls, frames, station, _facts(file, site, artifacts, run)) as record,
        Operator(asking.pause) as operator,
    ):
        rig = Rig(
            plan=file.plan,
            station=station if record is None else record.station(),
            beliefs=Beliefs(file.plan.beliefs, file.plan.features),
            artifacts=artifacts,
            journal=Journal(stream, station.clock, seq=seq),
            frames=frames,
            motion=Motion(operator.pause),
            gate=asking.gate,
            intents=intents,
        )
        errors_um = _watch(rig, site.cell, asking.progress)
        if site.cell is not None and call.station_file is None:
            keep_world(site.cell, run.cell)
        result = _run(rig, call, file, run, asking)
        if record is not None:
            _close(record, result)
    verdict = None if site.cell is None else _verdict(file.plan, site.cell)
    ended = Ended(
        folder=run.path,
        result=result,
        verdict=verdict,
        errors_um=errors_um,
        executors=before + 1,
    )
    _write_summary(call, site, file, ended)
    return ended


def _close(record: Record, result: RunResult) -> None:
    """End the record; that it cannot be hides no fault that came before."""
    try:
        record.close(result.code, result.message)
    except ExecutorError:
        if result.code is None:
            raise


def header_of(call: Call, file: PlanFile, devices: Mapping[str, str]) -> Header:
    """Return what a run is begun with; MP804 if the station file cannot be read."""
    station = call.station_file
    try:
        found = SIMULATED if station is None else _sha256(station.read_bytes())
    except OSError as error:
        raise ExecutorError("MP804", f"{station}: {error.strerror}") from error
    return Header(
        plan_sha256=file.sha256,
        station=found,
        seed=call.seed or 0,
        faults=call.faults,
        devices=devices,
    )


def keep_world(cell: Cell, path: Path) -> None:
    """Have a simulated cell keep its world beside the journal."""
    from executor.simulated.keeping import keep  # optics only for the simulated cell

    try:
        keep(cell, path)
    except OSError as error:
        raise ExecutorError("MP863", f"{path}: {error}") from error


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@contextmanager
def _recorded(
    path: Path, frames: Frames, station: Station, facts: Mapping[str, Any]
) -> Iterator[Record | None]:
    """Give the record of a run, None without frames: nothing could answer from it."""
    if not frames.wanted:
        yield None
        return
    with _open(path, "w") as stream:
        record = Record(stream, frames, station, facts)
        try:
            yield record
        except ExecutorError as error:  # an interrupt: MP860
            with suppress(ExecutorError):  # a full disk must not hide what happened
                record.close(error.code, error.message)
            raise


@contextmanager
def _open(path: Path, mode: Literal["a", "w"]) -> Iterator[TextIO]:
    """Give a file to write lines to; MP863 if it cannot be opened."""
    try:
        stream = path.open(mode, encoding="utf-8", errors=ESCAPED, newline="\n")
    except OSError as error:
        raise ExecutorError("MP863", f"{path}: {error}") from error
    try:
        yield stream
    finally:
        with suppress(OSError):  # what was not written is told where it was lost
            stream.close()


def _facts(
    file: PlanFile, site: Site, artifacts: Artifacts, run: RunFolder
) -> dict[str, Any]:
    """Return what a record says of its run beside the devices."""
    return {
        RESUMES: 0 if run.found is None else run.found.seq,
        "plan": file.plan.name,
        "plan_sha256": file.sha256,
        "arrays_sha256": artifacts.sha256,
        "station": site.name,
    }


def _run(
    rig: Rig, call: Call, file: PlanFile, run: RunFolder, asking: Asking
) -> RunResult:
    """Run the plan; whatever ends it, nothing is left in motion."""
    try:
        if run.found is None:
            begin(rig, header_of(call, file, rig.station.devices()))
        else:
            take_up(rig, run.found.past, asking.question)
        return run_plan(rig)
    except KeyboardInterrupt:
        left = "; ".join(rig.motion.stop(rig.station)) or "nothing moves any more"
        with suppress(ExecutorError, KeyboardInterrupt):  # what is left is told anyway
            rig.journal.write("stopped", why=left)
        raise ExecutorError("MP860", f"stopped; {left}") from None
    except BaseException:  # a bug must not leave anything in motion either
        rig.motion.stop(rig.station)
        raise


def _watch(
    rig: Rig, cell: Cell | None, progress: Callable[[str], None] | None
) -> dict[str, float]:
    """Return a record, filled while the rig runs: step -> its last look's true error.

    Only a simulated cell knows the truth; a plan never sees it. `progress` is told of
    every step.
    """
    errors: dict[str, float] = {}
    rig.on_step = progress
    if cell is None:
        return errors
    shown_um = cell.shown_um

    def note(target: str, x_um: float, y_um: float) -> None:
        owner, offset = rig.beliefs.anchor(target)
        true_x, true_y = shown_um(owner, *offset)
        errors[rig.journal.step] = math.hypot(x_um - true_x, y_um - true_y)

    enter = cell.faults.enter

    def begin_step(step: str) -> None:
        if progress is not None:
            progress(step)
        enter(step)

    rig.watch, rig.on_step = note, begin_step
    return errors


def _write_summary(call: Call, site: Site, file: PlanFile, ended: Ended) -> None:
    """Write summary.json and the table."""
    verdict, errors_um = ended.verdict, ended.errors_um
    extra: dict[str, Any] = {
        "plan_sha256": file.sha256,
        "station": site.name,
        "seed": call.seed or 0,
        "executors": ended.executors,
        "faults": list(call.faults),
        "cell_verdict": None if verdict is None else to_data(verdict),
        "true_look_error_um": to_data(errors_um),
    }
    try:
        words = table(ended.result, errors_um) + "\n"
        (ended.folder / "summary.txt").write_text(
            words, encoding="utf-8", errors=ESCAPED
        )
        text = summary_json(file.plan, ended.result, extra)
        fresh = ended.folder / FRESH  # as a whole or not at all: it says that it ended
        fresh.write_text(text, encoding="utf-8", errors=ESCAPED)
        fresh.replace(ended.folder / SUMMARY)
    except OSError as error:
        found = ended.result
        how = "done" if found.code is None else f"in {found.code}: {found.message}"
        raise ExecutorError(
            "MP863", f"the run has ended {how}; its summary: {error}"
        ) from error


def _verdict(plan: Plan, cell: Cell) -> Verdict | None:
    """Return what truly became of what the last verify step is about."""
    checks = [s.action for s in plan.steps if isinstance(s.action, VerifyAction)]
    if not checks or checks[-1].target.partition(".")[0] not in cell.truth.bodies:
        return None
    last = checks[-1]
    try:
        return cell.judge(last.target, last.on, last.within_um, last.within_rad)
    except (KeyError, ValueError):  # a plan of another world: nothing can be told
        return None
