"""Recorded calls of a run, answered again from the recording."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.record.recording import CALLS, COMMANDS, FORMAT, MORE_CALLS

# Far below what any axis resolves, above what other processors round otherwise.
SAME_UM = 1e-6
SAME_RAD = 1e-9
MOST_BYTES = 1 << 30  # of a record; an hour of readings every 20 ms is 40 MB
# ends that neither the plan nor a device brought about: the operator, or a disk
CUT_SHORT = ("MP860", "MP863")
_REAL = (int, float)
_NOW = "clock.now_s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """Record of one executor: its first line, the calls, how it ended."""

    path: Path
    head: Mapping[str, Any]
    rows: tuple[Mapping[str, Any], ...]
    broken_off: bool  # without a last line on how it ended
    ended: str | None  # its code, None: done

    @property
    def folder(self) -> Path:
        """Return the run folder."""
        return self.path.parent

    @property
    def unfinished(self) -> bool:
        """Return whether the run itself would have gone on."""
        return self.broken_off or self.ended in CUT_SHORT

    @property
    def commands(self) -> int:
        """Return the number of commands that were given."""
        return sum(is_command(row["call"]) for row in self.rows)


def records_of(folder: Path) -> tuple[Path, ...]:
    """Return the records of a run folder, one of every executor that worked on it."""
    try:
        later = [path for path in folder.glob(MORE_CALLS) if _number(path)]
    except OSError:  # reading the first one reports what is wrong with the folder
        later = []
    return (folder / CALLS, *sorted(later, key=_number))


def _number(path: Path) -> int:
    """Return which executor a record is of, 0 for a file that is none."""
    word = path.stem.rpartition("-")[2]
    return int(word) if word.isdecimal() else 0


def read_record(path: Path) -> Recorded:
    """Return the record of one executor.

    Raises
    ------
    ExecutorError
        MP877 if there is none, or it cannot be understood.
    """
    with failing("MP877", path, (OSError, UnicodeDecodeError)):
        if path.stat().st_size > MOST_BYTES:
            raise ExecutorError(
                "MP877", f"{path} is larger than {MOST_BYTES} bytes", place=path
            )
        lines = path.read_text(encoding="utf-8").split("\n")
    data = [_row(path, number, line) for number, line in _whole(lines)]
    if not data or data[0].get("microplan_record") != FORMAT:
        raise ExecutorError(
            "MP877", f"{path} does not begin as a record does", place=path
        )
    rows = sorted((r for r in data[1:] if "call" in r), key=lambda row: row["n"])
    ends = [r for r in data[1:] if "ended" in r]
    return Recorded(
        path=path,
        head=data[0],
        rows=tuple(rows),
        broken_off=not ends,
        ended=ends[-1]["ended"] if ends else None,
    )


def is_command(name: str) -> bool:
    """Return whether a call makes a device do something."""
    return name.partition(".")[2] in COMMANDS


@dataclass(slots=True)
class CallReplay:
    """Answers calls from a record and compares the commands with those in it.

    Commands must come in the order in which they were given. What is asked between two
    of them is answered in the order in which it was answered then, and by the last
    answer once there is no more: a run that asks more often can still be compared.
    """

    recorded: Recorded
    position: int = 0  # the first row after the last command
    used: int = 0  # commands
    difference: str = ""  # the first one found
    broken_off: bool = False  # the run went on where the record ends
    apart: float = 0.0  # largest difference of two numbers that count as the same
    _taken: dict[str, int] = field(default_factory=dict)  # call -> row to go on from
    _last: dict[str, Any] = field(default_factory=dict)
    _waited_s: float = 0.0

    def command(self, name: str, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the row of a command that was given then too.

        Raises
        ------
        ExecutorError
            MP876 if another was given; MP860 if the record breaks off; what the
            device raised.
        """
        rows = self.recorded.rows
        at = next(
            (k for k in range(self.position, len(rows)) if is_command(rows[k]["call"])),
            None,
        )
        if at is None:
            if self.recorded.unfinished:
                raise self._over()
            words = f"{call_text(name, given)}; the record has no more"
            raise self._parted(f"command {self.used + 1}: {words}")
        row, number = rows[at], self.used + 1
        apart = difference(name, given, row)
        if isinstance(apart, str):
            raise self._parted(f"command {number}: {apart}")
        self.apart = max(self.apart, apart)
        self.position, self.used = at + 1, number
        self._taken.clear()
        self._waited_s = 0.0
        return _raising(row)

    def query(self, name: str) -> Any:
        """Return the next answer of a device, or its last where there is no more."""
        rows = self.recorded.rows
        for k in range(self._taken.get(name, self.position), len(rows)):
            if is_command(rows[k]["call"]):
                break
            if rows[k]["call"] == name:
                self._taken[name] = k + 1
                self._last[name] = _raising(rows[k]).get("gave")
                if name == _NOW:
                    self._waited_s = 0.0
                return self._last[name]
        else:  # no command follows: the run was under way when the record ended
            if self.recorded.unfinished and name != _NOW:
                raise self._over()
        if name not in self._last:
            raise ExecutorError("MP877", f"the record has no answer of {name}")
        return self._last[name]

    def now_s(self) -> float:
        """Return the recorded time; waits count where the record has no more."""
        found = self.query(_NOW)
        return _float(found, _NOW) + self._waited_s

    def wait(self, seconds: float) -> None:
        """Let time pass in case the record does not hold how much did."""
        self._waited_s += seconds

    def left(self) -> str:
        """Return the first command that was not given again, "" if all were."""
        for row in self.recorded.rows[self.position :]:
            if is_command(row["call"]):
                return call_text(row["call"], row.get("with", {}))
        return ""

    def _over(self) -> ExecutorError:
        """Note that the replay went as far as it could; return what ends it."""
        self.broken_off = True
        return ExecutorError("MP860", f"the record ends after {self.used} commands")

    def _parted(self, words: str) -> ExecutorError:
        """Note the first difference and return the error about it."""
        self.difference = self.difference or words
        return ExecutorError("MP876", self.difference)


def difference(
    name: str, given: Mapping[str, Any], row: Mapping[str, Any]
) -> str | float:
    """Return a command's difference from the recorded one, in words if it is one.

    Times are not compared: they are not commanded.
    """
    then = row.get("with", {})
    if name != row["call"]:
        return f"{call_text(name, given)}; recorded was {call_text(row['call'], then)}"
    keys = sorted((set(given) | set(then)) - {"after_s"})
    largest = 0.0
    for key in keys:
        now, before = given.get(key), then.get(key)
        if not isinstance(now, _REAL) or not isinstance(before, _REAL):
            if now != before:
                return f"{name} {key} = {now}, recorded was {before}"
            continue
        apart = abs(now - before)
        if not apart <= (SAME_RAD if key.endswith("_rad") else SAME_UM):
            return f"{name} {key} = {now!r}, recorded was {before!r}"
        largest = max(largest, apart)
    return largest


def call_text(name: str, given: Mapping[str, Any]) -> str:
    """Return a command in words."""
    words = [f"{k}={v:.9g}" if isinstance(v, float) else f"{k}={v}"
             for k, v in given.items() if k != "after_s"]  # fmt: skip
    return " ".join((name, *words))


def numbers(found: Any, count: int, name: str) -> list[float]:
    """Return recorded numbers; MP877 if they are none."""
    if not isinstance(found, list) or len(found) != count:
        raise ExecutorError("MP877", f"{name} answered {found!r}")
    return [_float(value, name) for value in found]


def _float(value: Any, name: str) -> float:
    """Return a recorded number, nan and infinity too."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ExecutorError("MP877", f"{name} answered {value!r}")
    try:
        return float(value)
    except (ValueError, OverflowError):
        raise ExecutorError("MP877", f"{name} answered {value!r:.60}") from None


def _raising(row: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a row, or raise what the device raised, or did not answer."""
    if row.get("hung"):
        raise ExecutorError("MP844", f"{row['call']} did not answer in its time")
    if "raised" in row:
        kind, words = row["raised"]
        if kind == "TimeoutError":  # the one that is not just a failure
            raise TimeoutError(words)
        raise type(str(kind), (Exception,), {})(words)
    return row


def _whole(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Return the lines with their numbers; a last one that was cut off is left out."""
    found = [(k, line) for k, line in enumerate(lines, start=1) if line]
    return found if lines[-1] == "" else found[:-1]


def _row(path: Path, number: int, line: str) -> dict[str, Any]:
    """Return one line's data; MP877 if they are no row."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ExecutorError("MP877", f"{path}:{number}: {error}", place=path) from error
    if not isinstance(row, dict) or not _is_row(row):
        raise ExecutorError(
            "MP877", f"{path}:{number}: it is no call of a device", place=path
        )
    return row


def _is_row(row: Mapping[str, Any]) -> bool:
    """Return whether a line's keys are what they should be."""
    if not isinstance(row.get("ended"), str | None):
        return False
    raised = row.get("raised")  # by the device: kind and words
    return "call" not in row or (
        isinstance(row["call"], str)
        and isinstance(row.get("n"), int)
        and isinstance(row.get("with", {}), dict)
        and (raised is None or (isinstance(raised, list) and len(raised) == 2))
    )
