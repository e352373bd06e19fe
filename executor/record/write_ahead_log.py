"""Write-ahead log of a run: each motion is on disk before it begins.

One JSON object a line, with a number and a checksum that hangs on the line before.
`docs/journal.md` lists the kinds of lines.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TextIO

from microplan.executor.devices.drivers import AxisReading, Clock
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import Phase
from microplan.schemas.codec import to_data

# a name or a driver's words may hold a lone half of a character, which UTF-8 has not;
# written so it is what JSON calls it
ESCAPED = "backslashreplace"


class Journal:
    """Writes numbered events to a stream as they happen."""

    def __init__(self, stream: TextIO, clock: Clock, *, seq: int = 0) -> None:
        self._stream = stream
        self._clock = clock
        self._seq = seq  # of the last event that is there
        self.step = ""  # that events belong to, "" between steps

    def enter(self, step: str) -> None:
        """Name the step that the events to come belong to."""
        self.step = step

    def write(self, event: str, **details: Any) -> None:
        """Append one event; `details` are JSON data or frozen dataclasses.

        Raises
        ------
        ExecutorError
            MP863 if it cannot be written.
        """
        self._seq += 1
        line = {
            "seq": self._seq,
            "t_s": round(self._clock.now_s(), 6),
            "step": self.step,
            "event": event,
            **{name: to_data(value) for name, value in details.items()},
        }
        try:
            self._stream.write(json.dumps(line, ensure_ascii=False) + "\n")
            self._stream.flush()
        except OSError as error:
            raise ExecutorError("MP863", f"event {self._seq}: {error}") from error


FILE = "journal.jsonl"
FORMAT = 1
# names of motions that a resumed step makes again where it needs them
AWAY = {"near": "back", "probe": "probe back"}  # for a look, and what ends it
REPEATED = ("", *AWAY, *AWAY.values())
EXACT = 17  # significant digits that give back every float64
MARK = b'{"crc": "'  # how a line begins
HEAD = len(MARK + b'00000000", ')


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveReadings:
    """Readings of all drives that touch anything, at one moment."""

    stage: AxisReading
    robot: AxisReading | None
    opening_um: float | None  # of the jaws


@dataclass(frozen=True, slots=True, kw_only=True)
class Intent:
    """Intent of one motion, written before it begins."""

    step: str
    name: str  # within the step; "": one that a resumed step decides on anew
    device: Literal["stage", "robot", "jaws"]
    target: Mapping[str, float]  # absolute, by axis; of the jaws "opening_um"
    phase: Phase
    irreversible: bool  # never to be done twice
    before: DriveReadings


class LogStore(Protocol):
    """Store of a log's lines."""

    def append(self, line: bytes) -> None:
        """Return when the line would survive a loss of power; OSError if it cannot."""
        ...


class FileStore:
    """A file whose lines are on the disk when `append` returns.

    Parameters
    ----------
    path : Path
        The file; it is made if it is missing.
    size : int
        Bytes at its beginning that stay: what follows is a line that was torn.
    sync : callable
        Has the bytes of a file descriptor on the disk when it returns.
    """

    def __init__(
        self, path: Path, size: int = 0, *, sync: Callable[[int], None] = os.fsync
    ) -> None:
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0)
        self._file = os.open(path, flags, 0o644)
        self._sync = sync
        os.ftruncate(self._file, size)
        os.lseek(self._file, size, os.SEEK_SET)
        sync(self._file)
        sync_folder(path.parent)

    def append(self, line: bytes) -> None:
        """Write a line and wait until the disk has it."""
        left = memoryview(line)
        while left:  # a disk that fills takes part of it and fails afterwards
            left = left[os.write(self._file, left) :]
        self._sync(self._file)

    def close(self) -> None:
        """Give the file back."""
        os.close(self._file)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, where the system can do that."""
    if os.name != "posix":
        return
    found = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(found)
    finally:
        os.close(found)


def sealed(body: str, chain: int) -> tuple[bytes, int]:
    """Return a line for a JSON object, and the checksum that the next one hangs on."""
    chain = zlib.crc32(body.encode(), chain)
    return f'{{"crc": "{chain:08x}", {body[1:]}\n'.encode(), chain


def opened(line: bytes, chain: int) -> tuple[dict[str, Any], int] | None:
    """Return the contents of a line and the next checksum; None if it is damaged."""
    body = b"{" + line[HEAD:].removesuffix(b"\n")
    chain = zlib.crc32(body, chain)
    if line[:HEAD] != f'{{"crc": "{chain:08x}", '.encode():
        return None
    try:
        found = json.loads(body)
    except ValueError:
        return None
    return found, chain


class WriteAheadLog:
    """Writes the journal; without a store it keeps nothing.

    After a line that could not be written no further one is: it would follow a torn
    one.

    Parameters
    ----------
    store : LogStore or None
        Where lines go.
    seq, chain : int
        Number and checksum of the last line that is there.
    """

    def __init__(
        self, store: LogStore | None = None, *, seq: int = 0, chain: int = 0
    ) -> None:
        self._store = store
        self._seq, self._chain = seq, chain
        self._broken = ""

    def write(self, kind: str, **details: Any) -> None:
        """Append a line and wait until it is on the disk.

        Parameters
        ----------
        kind : str
            What the line holds.
        details
            JSON data or frozen dataclasses; numbers are kept exactly.

        Raises
        ------
        ExecutorError
            MP863 if it cannot be written; so is every later one then.
        """
        if self._store is None:
            return
        if self._broken:
            raise ExecutorError("MP863", self._broken)
        data = {name: to_data(value, EXACT) for name, value in details.items()}
        body = json.dumps({"seq": self._seq + 1, "kind": kind, **data})
        line, chain = sealed(body, self._chain)
        try:
            self._store.append(line)
        except OSError as error:
            self._broken = f"line {self._seq + 1} of {FILE}: {error}"
            raise ExecutorError("MP863", self._broken) from error
        self._seq, self._chain = self._seq + 1, chain
