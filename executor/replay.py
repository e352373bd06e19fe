"""A run again, on the record of its devices: does it give the same commands?"""

from __future__ import annotations

import io
from dataclasses import dataclass

from executor.artifacts import Artifacts
from executor.beliefs import Beliefs
from executor.errors import ExecutorError
from executor.frames import Frames
from executor.journal import Journal
from executor.plan_file import PlanFile
from executor.rig import Rig
from executor.run import RunResult, run_plan
from executor.tape import Recorded, Tape
from executor.tape_station import tape_station


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """How a replay went; `difference` is "" if the commands are the same."""

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
    record.

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
        MP877 if the record is of another plan, or cannot be used.
    """
    head = recorded.head
    for key, now in (("plan_sha256", file.sha256), ("arrays_sha256", artifacts.sha256)):
        if head.get(key) != now and not anyway:
            raise ExecutorError(
                "MP877",
                f"the record is of another plan: its {key} is {head.get(key)}, this "
                f"one's {now}",
            )
    tape = Tape(recorded)
    station = tape_station(tape, anyway=anyway)
    rig = Rig(
        plan=file.plan,
        station=station,
        beliefs=Beliefs(file.plan.beliefs, file.plan.features),
        artifacts=artifacts,
        journal=Journal(io.StringIO(), _Silent()),
        frames=Frames(None, wanted=bool(head.get("whole_frames"))),
    )
    result = run_plan(rig)
    return _judged(tape, result)


def _judged(tape: Tape, result: RunResult) -> Replayed:
    """Return how far commands and outcome are the same; MP877 as it came."""
    recorded = tape.recorded
    if result.code == "MP877":
        raise ExecutorError("MP877", result.message)
    words, left = tape.difference, tape.left()
    if not words and left and not tape.broken_off:
        words = f"command {tape.used + 1}: none any more, recorded was {left}"
        words += _because(result)
    if not words and not recorded.unfinished and result.code != recorded.ended:
        words = f"the run ends in {result.code or 'done'}, recorded was "
        words += recorded.ended or "done"
    return Replayed(
        commands=recorded.commands,
        same=tape.used,
        difference=words,
        apart=tape.apart,
        broken_off=tape.broken_off,
        result=result,
    )


def _because(result: RunResult) -> str:
    """Return why a replay ended early."""
    if result.code is None:
        return "; the run is done"
    return f"; step {result.step} ends in {result.code}: {result.message}"


class _Silent:
    """The clock of a log that nobody reads: what it asks is not on the tape."""

    def now_s(self) -> float:
        """Return 0."""
        return 0.0

    def wait(self, seconds: float) -> None:
        """Return at once."""
