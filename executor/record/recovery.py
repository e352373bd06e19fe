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
from microplan.executor.simulated.cameras.kinds import CameraKind
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.plan import View


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Header of a journal: what a run was begun with; none of it may change."""

    plan_sha256: str
    station: str  # "sim", or the sha256 of the station file
    seed: int  # of the simulated cell; 0 with a station file
    faults: tuple[str, ...]
    devices: Mapping[str, str]  # role -> model and serial number
    camera: CameraKind | None = None  # of the simulated cell; None: quick


@dataclass(slots=True, kw_only=True)
class ResumeState:
    """State that a run is resumed from: finished steps, motions of the present one.

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
    state: ResumeState
    seq: int  # of the last whole line
    chain: int
    size: int  # bytes; a torn line may follow


def read_journal(path: Path) -> ReadJournal:
    """Return the contents of a journal; see `journal_in`."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ExecutorError("MP867", f"{path}: {error.strerror}") from error
    return journal_in(data, str(path))


def journal_in(data: bytes, name: str = FILE) -> ReadJournal:
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
        header, state = _read_back(records)
    except (CodecError, KeyError, TypeError) as error:
        raise ExecutorError("MP867", f"{name}: {error}") from error
    return ReadJournal(header=header, state=state, seq=seq, chain=chain, size=size)


def is_open(folder: Path) -> bool:
    """Return whether a folder holds a run that was begun and not brought to an end.

    One that the operator stopped counts: it is there to go on with.
    """
    path = folder / FILE
    if not is_file(path):
        return False
    try:
        state = read_journal(path).state
    except ExecutorError as error:
        return error.code != "MP868"  # a damaged one has no end
    return not state.ended or state.code == "MP860"


def _read_back(records: Sequence[Mapping[str, Any]]) -> tuple[Header, ResumeState]:
    """Return what the lines add up to."""
    first, state = records[0], ResumeState()
    if first["kind"] != "run" or first["format"] != FORMAT:
        raise CodecError(f"no journal of format {FORMAT}")
    state.standing = from_data(DriveReadings, first["standing"])
    for record in records[1:]:
        _KINDS[record["kind"]](state, record)
    return from_data(Header, first["header"]), state


def _begin(state: ResumeState, record: Mapping[str, Any]) -> None:
    if record["step"] != state.step:
        state.step, state.finished, state.errors_um = record["step"], set(), []
        state.away = None


def _intent(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.opened = from_data(Intent, record["intent"])
    if state.opened.name in AWAY and state.away is None:
        state.away = state.opened


def _done(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.done(record["name"], from_data(DriveReadings, record["standing"]))


def _resumed(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.close(record["was"] == "done", from_data(DriveReadings, record["standing"]))


def _undone(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.finished.discard(record["name"])


def _known(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.known = from_data(BeliefRecord, record["known"])


def _error(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.errors_um.append(float(record["error_um"]))


def _view(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.view = from_data(View, record["view"])


def _step(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.results.append(from_data(StepResult, record["result"]))
    state.phase = record["phase"]
    _known(state, record)


def _end(state: ResumeState, record: Mapping[str, Any]) -> None:
    state.ended, state.code = True, record["code"]
    state.errors_um = []  # what failed by them begins anew when it is resumed


_KINDS = {
    "begin": _begin, "intent": _intent, "done": _done, "resumed": _resumed,
    "undone": _undone, "known": _known, "error": _error, "view": _view,
    "step": _step, "end": _end,
}  # fmt: skip
