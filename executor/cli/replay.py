"""Replay of a run on the record of its devices: are the commands the same?"""

from __future__ import annotations

import io
from dataclasses import dataclass

from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.outcome import RunResult
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.recorded_calls import CallReplay, Recorded
from microplan.executor.record.recording import CALLS, RESUMES
from microplan.executor.record.recovery import ResumeState, journal_in
from microplan.executor.record.replay_station import replay_station
from microplan.executor.record.write_ahead_log import FILE, Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.resume import take_up
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig

ASKED = "MP864"  # how a run ends whose question the operator did not say yes to


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """Result of a replay; `difference` is "" if the commands are the same."""

    commands: int  # that were given in the record
    same: int  # of them, up to the first difference
    difference: str
    apart: float  # largest difference of two numbers that count as the same
    broken_off: bool  # the record ends before the plan does
    result: RunResult


def replay(
    file: PlanFile, artifacts: Artifacts, recorded: Recorded, *, anyway: bool = False
) -> Replayed:
    """Return whether a plan on a record gives the commands of the record.

    The core is that of any run; only the devices are others, which answer from the
    record. An executor that resumed the run begins from the journal as it was then.

    Parameters
    ----------
    file : PlanFile
        The plan.
    artifacts : Artifacts
        Its routines.
    recorded : Recorded
        The record.
    anyway : bool
        Whether to go on with another plan, or frames that were changed.

    Raises
    ------
    ExecutorError
        MP877 if the record is of another plan, or cannot be used; MP867 if the journal
        that its executor resumed from is damaged.
    """
    head, state = recorded.head, _state_before(recorded)
    for key, now in (("plan_sha256", file.sha256), ("arrays_sha256", artifacts.sha256)):
        if head.get(key) != now and not anyway:
            raise ExecutorError(
                "MP877",
                f"the record is of another plan: its {key} is {head.get(key)}, this "
                f"one's {now}",
            )
    calls = CallReplay(recorded)
    station = replay_station(calls, anyway=anyway)
    rig = Rig(
        plan=file.plan,
        station=station,
        beliefs=Beliefs(file.plan.beliefs, file.plan.features),
        artifacts=artifacts,
        journal=Journal(io.StringIO(), _Silent()),
        frames=Frames(None, wanted=bool(head.get("whole_frames"))),
    )
    return _judged(calls, _run(rig, state, recorded))


def _state_before(recorded: Recorded) -> ResumeState | None:
    """Return what the executor of a record resumed from; None if it began the run."""
    count = recorded.head.get(RESUMES)
    if count is None and recorded.path.name == CALLS:
        return None  # of an executor of an older format
    if not isinstance(count, int) or isinstance(count, bool) or count < 0:
        raise ExecutorError(
            "MP877", f"{recorded.path} does not say from where it resumed the run"
        )
    if count == 0:
        return None
    path = recorded.path.with_name(FILE)
    with failing("MP877", path):
        lines = path.read_bytes().splitlines(keepends=True)
    if len(lines) < count:
        raise ExecutorError(
            "MP877", f"{path} has {len(lines)} lines, the run was resumed from {count}"
        )
    return journal_in(b"".join(lines[:count]), str(path)).state


def _run(rig: Rig, state: ResumeState | None, recorded: Recorded) -> RunResult:
    """Begin, or go on, as the executor did."""

    def answer(_question: str) -> bool:
        return recorded.ended != ASKED  # as the operator answered then

    try:
        if state is None:
            rig.standing()  # the journal's first line holds it
        else:
            take_up(rig, state, answer)
    except ExecutorError as error:
        return RunResult(
            code=error.code, message=error.message, step=None, steps=(), time_s=0.0
        )
    return run_plan(rig)


def _judged(calls: CallReplay, result: RunResult) -> Replayed:
    """Return how far commands and outcome are the same; MP877 as it came."""
    recorded = calls.recorded
    if result.code == "MP877":
        raise ExecutorError("MP877", result.message)
    words, left = calls.difference, calls.left()
    if not words and left and not calls.broken_off:
        words = f"command {calls.used + 1}: none any more, recorded was {left}"
        words += _because(result)
    if not words and not recorded.unfinished and result.code != recorded.ended:
        words = f"the run ends in {result.code or 'done'}, recorded was "
        words += recorded.ended or "done"
    return Replayed(
        commands=recorded.commands,
        same=calls.used,
        difference=words,
        apart=calls.apart,
        broken_off=calls.broken_off,
        result=result,
    )


def _because(result: RunResult) -> str:
    """Return why a replay ended early."""
    if result.code is None:
        return "; the run is done"
    return f"; step {result.step} ends in {result.code}: {result.message}"


class _Silent:
    """Clock of a log that is not read: its calls are not in the recording."""

    def now_s(self) -> float:
        """Return 0."""
        return 0.0

    def wait(self, seconds: float) -> None:
        """Return at once."""
