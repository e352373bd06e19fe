"""Session of a whole run: the plan on a station, its logs, its result."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TextIO

from microplan.executor.cli.options import RunOptions
from microplan.executor.cli.run_result import (
    Ended,
    judged,
    keep_world,
    watch,
    write_summary,
)
from microplan.executor.cli.select_station import SIMULATED, Site
from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.devices.station import Station
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.motion.motion import Motion
from microplan.executor.motion.operator import Operator
from microplan.executor.record.frames import Frames
from microplan.executor.record.outcome import RunResult
from microplan.executor.record.plan_file import PlanFile, world_beside
from microplan.executor.record.recording import CALLS, RESUMES, CallRecorder
from microplan.executor.record.recovery import Header
from microplan.executor.record.run_folder import EVENTS, RunFolder
from microplan.executor.record.write_ahead_log import ESCAPED, Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.resume import begin, take_up
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.schemas.files.times import planned_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """Questions to the operator; None where there is no operator."""

    pause: Callable[[], bool] | None = None  # whether to go on after Ctrl-C
    question: Callable[[str], bool] | None = None  # whether to go on after a crash
    gate: Callable[[str], None] | None = None  # see `Rig.gate`
    progress: Callable[[str], None] | None = None  # called with every step that begins


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJob:
    """A plan that is to be run: as asked for, where, and where the run is kept."""

    options: RunOptions
    file: PlanFile
    site: Site
    artifacts: Artifacts  # of the plan's routines
    run: RunFolder  # locked, and emptied for a new run


def run_whole_plan(job: RunJob, asking: Asking) -> Ended:
    """Run the plan, or what is left of it, and write the run folder.

    Parameters
    ----------
    job : RunJob
        The plan, and where it is run.
    asking : Asking
        What the operator can be asked.

    Raises
    ------
    ExecutorError
        MP860 if the run is interrupted; MP863 if something cannot be written; codes of
        `microplan.executor.run.resume.take_up`.
    """
    options, file, site, run = job.options, job.file, job.site, job.run
    seq, before = run.last_event(), run.executors
    with _rigged(job, asking, seq, before) as (rig, record):
        errors_um = watch(rig, site.cell, asking.progress)
        if site.cell is not None and options.station_file is None:
            keep_world(site.cell, run.cell)
        result = _run(rig, job, asking)
        if record is not None:
            _close(record, result)
    ended = Ended(
        folder=run.path,
        result=result,
        verdict=None if site.cell is None else judged(file.plan, site.cell),
        errors_um=errors_um,
        executors=before + 1,
        faults=() if site.cell is None else site.cell.faults.asked,
        idle_faults=None if site.cell is None or before else site.cell.faults.idle,
    )
    write_summary(options, site, file, ended)
    return ended


@contextmanager
def _rigged(
    job: RunJob, asking: Asking, seq: int, before: int
) -> Iterator[tuple[Rig, CallRecorder | None]]:
    """Give all that steps are done with, and the record; None: it cannot be replayed.

    The run's files go on after `seq` events of `before` earlier executors.
    """
    run, plan, station = job.run, job.file.plan, job.site.station
    tag = f"_by{before + 1}" if before else ""
    frames = Frames(run.path if job.options.frames else None, tag=tag)
    calls = run.path / (f"calls-{before + 1}.jsonl" if before else CALLS)
    facts = {
        RESUMES: 0 if run.found is None else run.found.seq,
        "plan": plan.name,
        "plan_sha256": job.file.sha256,
        "arrays_sha256": job.artifacts.sha256,
        "station": job.site.name,
    }
    with (
        _open(run.path / EVENTS, "a") as stream,
        run.write_ahead() as write_ahead,
        _recorded(calls, frames, station, facts) as record,
        Operator(asking.pause) as operator,
    ):
        rig = Rig(
            plan=plan,
            station=station if record is None else record.station(),
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=job.artifacts,
            journal=Journal(stream, station.clock, seq=seq),
            frames=frames,
            motion=Motion(operator.pause),
            gate=asking.gate,
            write_ahead=write_ahead,
            planned_s=planned_s(plan, world_beside(job.options.folder)),
        )
        yield rig, record


def _close(record: CallRecorder, result: RunResult) -> None:
    """End the record; that it cannot be hides no fault that came before."""
    try:
        record.close(result.code, result.message)
    except ExecutorError:
        if result.code is None:
            raise


def header_of(
    options: RunOptions,
    file: PlanFile,
    devices: Mapping[str, str],
    source: bytes | None = None,
) -> Header:
    """Return the header of a run's journal; MP804 if the station file cannot be read.

    `source` are the bytes that the station was made from: the file may be another one
    by now. Without them it is read.
    """
    station, camera = options.station_file, options.simulated_camera
    if source is None and station is not None:
        with failing("MP804", station):
            source = station.read_bytes()
    return Header(
        plan_sha256=file.sha256,
        station=SIMULATED if source is None else hashlib.sha256(source).hexdigest(),
        seed=options.seed or 0,
        faults=options.faults,
        devices=devices,
        camera=None if camera == "quick" else camera,
    )


@contextmanager
def _recorded(
    path: Path, frames: Frames, station: Station, facts: Mapping[str, Any]
) -> Iterator[CallRecorder | None]:
    """Give the record of a run, None without frames: nothing could answer from it."""
    if not frames.wanted:
        yield None
        return
    with _open(path, "w") as stream:
        record = CallRecorder(stream, frames, station, facts)
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
        with suppress(OSError):  # what was not written is reported where it was lost
            stream.close()


def _run(rig: Rig, job: RunJob, asking: Asking) -> RunResult:
    """Run the plan; whatever ends it, nothing is left in motion."""
    try:
        if job.run.found is None:
            devices = rig.station.devices()
            begin(rig, header_of(job.options, job.file, devices, job.site.source))
        else:
            take_up(rig, job.run.found.state, asking.question)
        return run_plan(rig)
    except KeyboardInterrupt:
        left = "; ".join(rig.motion.stop(rig.station)) or "nothing moves any more"
        with suppress(ExecutorError, KeyboardInterrupt):  # what is left is in the error
            rig.journal.write("stopped", why=left)
        raise ExecutorError("MP860", f"stopped; {left}") from None
    except BaseException:  # a bug must not leave anything in motion either
        rig.motion.stop(rig.station)
        raise
