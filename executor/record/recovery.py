"""Recovery of an interrupted run: its journal, read back with its checksums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import Phase
from microplan.executor.devices.station_file import is_file
from microplan.executor.motion.beliefs import BeliefRecord
from microplan.executor.record.outcome import StepResult
from microplan.executor.record.write_ahead_log import (
    AWAY,
    FILE,
    FORMAT,
    MARK,
    REPEATED,
    DriveReadings,
    Intent,
    opened,
)
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.plan import View


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What a run was begun with; none of it may change."""

    plan_sha256: str
    station: str  # "sim", or the sha256 of the station file
    seed: int  # of the simulated cell; 0 with a station file
    faults: tuple[str, ...]
    devices: Mapping[str, str]  # role -> model and serial number


@dataclass(slots=True, kw_only=True)
class ResumeState:
    """How far the run had come, and what of its present step is done.

    An empty one is that of a run that begins.
    """

    results: list[StepResult] = field(default_factory=list)  # of finished steps
    step: str = ""  # begun last
    finished: set[str] = field(default_factory=set)  # names of its motions
    opened: Intent | None = None  # begun, perhaps, and not known to be done
    again: Intent | None = None  # to be brought to its target
    away: Intent | None = None  # brought the axes near a look, and nothing back
    errors_um: list[float] = field(default_factory=list)  # of its alignment's looks
    known: BeliefRecord | None = None
    phase: Phase = "approach"  # after the last finished step
    view: View | None = None  # what the zoom was last sent to
    standing: DriveReadings | None = None
    ended: bool = False
    code: str | None = None  # why it ended

    def done(self, name: str, standing: DriveReadings) -> None:
        """Note that the motion begun last has ended at its target."""
        self.opened, self.standing = None, standing
        if self.away is not None and name == AWAY[self.away.name]:
            self.away = None
        if name not in REPEATED:
            self.finished.add(name)

    def close(self, done: bool, standing: DriveReadings) -> None:  # noqa: FBT001 - a fact
        """Note what became of the motion begun last, and the present readings."""
        intent, self.opened, self.standing = self.opened, None, standing
        self.ended, self.code = False, None
        if intent is not None and done:
            self.done(intent.name, standing)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadJournal:
    """A journal as it was found."""

    header: Header
    past: ResumeState
    seq: int  # of the last whole line
    chain: int
    size: int  # bytes; a torn line may follow


def read_past(path: Path) -> ReadJournal:
    """Return the contents of a journal; see `past_in`."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ExecutorError("MP867", f"{path}: {error.strerror}") from error
    return past_in(data, str(path))


def past_in(data: bytes, name: str = FILE) -> ReadJournal:
    """Return the contents of a journal's bytes.

    The last line may be torn or damaged: it was not yet on the disk when the executor
    died, so what it announces had not begun, or is seen from the readings.

    Raises
    ------
    ExecutorError
        MP867 if another line is damaged, missing or not understood; MP868 if there is
        no whole line.
    """
    lines, seq, chain, size = data.splitlines(keepends=True), 0, 0, 0
    records = []
    for number, line in enumerate(lines, start=1):
        found = opened(line, chain) if line.endswith(b"\n") else None
        if found is None or found[0].get("seq") != number:
            if number == len(lines) and MARK not in line[1:]:
                break
            raise ExecutorError("MP867", f"{name}: line {number} is damaged")
        records.append(found[0])
        seq, chain, size = number, found[1], size + len(line)
    if not records:
        raise ExecutorError("MP868", f"{name} tells nothing: nothing had begun")
    try:
        header, past = _told(records)
    except (CodecError, KeyError, TypeError) as error:
        raise ExecutorError("MP867", f"{name}: {error}") from error
    return ReadJournal(header=header, past=past, seq=seq, chain=chain, size=size)


def is_open(folder: Path) -> bool:
    """Return whether a folder holds a run that was begun and not brought to an end.

    One that the operator stopped counts: it is there to go on with.
    """
    path = folder / FILE
    if not is_file(path):
        return False
    try:
        past = read_past(path).past
    except ExecutorError as error:
        return error.code != "MP868"  # a damaged one has no end
    return not past.ended or past.code == "MP860"


def _told(records: Sequence[Mapping[str, Any]]) -> tuple[Header, ResumeState]:
    """Return what the lines add up to."""
    first, past = records[0], ResumeState()
    if first["kind"] != "run" or first["format"] != FORMAT:
        raise CodecError(f"no journal of format {FORMAT}")
    past.standing = from_data(DriveReadings, first["standing"])
    for record in records[1:]:
        _KINDS[record["kind"]](past, record)
    return from_data(Header, first["header"]), past


def _begin(past: ResumeState, record: Mapping[str, Any]) -> None:
    if record["step"] != past.step:
        past.step, past.finished, past.errors_um = record["step"], set(), []
        past.away = None


def _intent(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.opened = from_data(Intent, record["intent"])
    if past.opened.name in AWAY and past.away is None:
        past.away = past.opened


def _done(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.done(record["name"], from_data(DriveReadings, record["standing"]))


def _resumed(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.close(record["was"] == "done", from_data(DriveReadings, record["standing"]))


def _undone(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.finished.discard(record["name"])


def _known(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.known = from_data(BeliefRecord, record["known"])


def _error(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.errors_um.append(float(record["error_um"]))


def _view(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.view = from_data(View, record["view"])


def _step(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.results.append(from_data(StepResult, record["result"]))
    past.phase = record["phase"]
    _known(past, record)


def _end(past: ResumeState, record: Mapping[str, Any]) -> None:
    past.ended, past.code = True, record["code"]
    past.errors_um = []  # what failed by them begins anew when it is resumed


_KINDS = {
    "begin": _begin, "intent": _intent, "done": _done, "resumed": _resumed,
    "undone": _undone, "known": _known, "error": _error, "view": _view,
    "step": _step, "end": _end,
}  # fmt: skip
