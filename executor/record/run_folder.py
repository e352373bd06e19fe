"""The run folder: locked by one process, kept from loss, emptied for a new run."""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from microplan.executor.devices.errors import ExecutorError, failing, why
from microplan.executor.devices.station_file import is_file
from microplan.executor.record.frames import FOLDER
from microplan.executor.record.recording import CALLS, MORE_CALLS
from microplan.executor.record.recovery import (
    Header,
    ReadJournal,
    is_open,
    read_journal,
)
from microplan.executor.record.write_ahead_log import FILE, FileStore, WriteAheadLog

if sys.platform == "win32":  # pragma: no cover - there is no fcntl
    import msvcrt

    _FAR = 1 << 20  # a byte that is never written: what is locked cannot be read there

    def _take(number: int) -> None:
        os.lseek(number, _FAR, os.SEEK_SET)
        msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(number: int) -> None:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def held(path: Path, what: str) -> Iterator[None]:
    """Hold a lock file while inside.

    The file stays, empty, and a process that was killed leaves no lock behind.

    Parameters
    ----------
    path : Path
        The lock file; it is made if it is missing.
    what : str
        What is locked, for the message.

    Raises
    ------
    ExecutorError
        MP861 if another process holds it, with its number and host; MP804 if there
        can be no such file.
    """
    with failing("MP804", path):
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            _take(number)
        except OSError as error:
            holder = _holder(path)
            raise ExecutorError("MP861", f"{what} is held by {holder}") from error
        _write(number, f"process {os.getpid()} on {platform.node()}\n")
        yield
    finally:
        os.close(number)


def _write(number: int, text: str) -> None:
    """Put the holder's name into the file; a full disk is no obstacle."""
    with suppress(OSError):
        os.ftruncate(number, 0)
        os.lseek(number, 0, os.SEEK_SET)
        os.write(number, text.encode())


def _holder(path: Path) -> str:
    """Return the holder of a lock, as far as its file has it."""
    try:
        return path.read_text(encoding="utf-8").strip() or "another process"
    except (OSError, UnicodeDecodeError):
        return "another process"


EVENTS = "events.jsonl"
LOCK = "lock"
SUMMARY = "summary.json"
FRESH = "summary.new"  # until it is whole
CELL = "cell.json"  # the simulated cell's own
PLAN = "plan.json"
STATION = "station.toml"
REPORT = "report.html"
# what a run leaves in its folder: nothing else is ever deleted
OURS = {LOCK, EVENTS, FILE, SUMMARY, CELL, PLAN, STATION, FOLDER, CALLS,
        FRESH, REPORT, "summary.txt", "cell.new", f"{REPORT}.new"}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolder:
    """A locked run folder; `found` is what an earlier executor left there to resume."""

    path: Path
    found: ReadJournal | None

    @property
    def header(self) -> Header:
        """Return the header of the run's journal.

        Raises
        ------
        ValueError
            If it has not begun.
        """
        if self.found is None:
            raise ValueError(f"the run in {self.path} has not begun")
        return self.found.header

    @property
    def cell(self) -> Path:
        """Return the path of a simulated cell's state."""
        return self.path / CELL

    def begin(self, plan_file: Path, plan: bytes, station: bytes | None) -> None:
        """Empty the folder, and keep what the run is begun with.

        The journal goes last: while it is there, this is a run folder.

        Parameters
        ----------
        plan_file : Path
            Where the plan is: never in the run folder.
        plan, station : bytes
            The files as they were read; no station file on the simulated cell.

        Raises
        ------
        ExecutorError
            MP804 if that cannot be done.
        """
        if plan_file.resolve().parent == self.path.resolve():
            raise ExecutorError(
                "MP804", f"the plan itself is in {self.path}", place=self.path
            )
        with failing("MP804", self.path):
            for path in self.path.iterdir():
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                elif path.name not in (LOCK, FILE):
                    path.unlink()
            (self.path / FILE).write_bytes(b"")
            (self.path / PLAN).write_bytes(plan)
            if station is not None:
                (self.path / STATION).write_bytes(station)

    @contextmanager
    def write_ahead(self) -> Iterator[WriteAheadLog]:
        """Return the journal, open for what comes next; a torn line is cut off."""
        found = self.found
        seq, chain, size = (
            (0, 0, 0) if found is None else (found.seq, found.chain, found.size)
        )
        with failing("MP863", self.path / FILE):
            store = FileStore(self.path / FILE, size)
        try:
            yield WriteAheadLog(store, seq=seq, chain=chain)
        finally:
            store.close()

    @property
    def executors(self) -> int:
        """Return the number of executors that worked on the run before this one."""
        calls = len(list(self.path.glob("calls*.jsonl")))
        return 0 if self.found is None else max(calls, 1)

    def last_event(self) -> int:
        """Return the number of the last event, 0 for none; a torn one is cut off."""
        path = self.path / EVENTS
        if self.found is None or not is_file(path):
            return 0
        with failing("MP867", path, (OSError, ValueError, KeyError, TypeError)):
            data = path.read_bytes()
            whole = data[: data.rfind(b"\n") + 1]
            if len(whole) < len(data):  # never written anew: the disk may be full
                os.truncate(path, len(whole))
            lines = whole.splitlines()
            return int(json.loads(lines[-1])["seq"]) if lines else 0


def check_free(path: Path, *, discard: bool) -> None:
    """Refuse to begin a run in a folder that holds something to be kept.

    Raises
    ------
    ExecutorError
        MP804 if it is no run folder, or holds anything else; MP862 if its run did not
        end, unless it may be discarded.
    """
    try:
        names = {entry.name for entry in path.iterdir()}
    except FileNotFoundError:
        return
    except OSError as error:
        raise ExecutorError("MP804", f"{path}: {why(error)}", place=path) from error
    if names - {LOCK} and not names & {EVENTS, FILE}:
        raise ExecutorError("MP804", f"{path} exists and is no run folder", place=path)
    others = sorted(n for n in names - OURS if not fnmatchcase(n, MORE_CALLS))
    if others:
        raise ExecutorError(
            "MP804",
            f"{path} holds {', '.join(others[:3])}, which no run left there",
            place=path,
        )
    if not discard and is_open(path):
        raise ExecutorError(
            "MP862",
            f"{path}: go on with it by --resume, throw it away by --discard, or name "
            "another folder by --run-dir",
            place=path,
        )


@contextmanager
def new_run(path: Path, *, discard: bool) -> Iterator[RunFolder]:
    """Lock a folder for a new run; codes of `check_free`, MP861 if it is in use."""
    check_free(path, discard=discard)
    with failing("MP804", path):
        path.mkdir(parents=True, exist_ok=True)
    with held(path / LOCK, str(path)):
        check_free(path, discard=discard)
        yield RunFolder(path=path, found=None)


@contextmanager
def old_run(path: Path) -> Iterator[RunFolder]:
    """Lock the folder of a run that is to be resumed.

    Raises
    ------
    ExecutorError
        MP861 if it is in use; MP867 if its journal is damaged; MP868 if there is no
        run, or it was done.
    """
    if not is_file(path / FILE):
        raise ExecutorError("MP868", f"{path} holds no {FILE}", place=path)
    with held(path / LOCK, str(path)):
        found = read_journal(path / FILE)
        done = found.state.ended and found.state.code is None
        if done and is_file(path / SUMMARY):  # the last thing that is written
            raise ExecutorError("MP868", f"the run in {path} was done", place=path)
        yield RunFolder(path=path, found=found)


def lock_beside(station_file: Path) -> AbstractContextManager[None]:
    """Lock a station; MP861 if another executor works on it."""
    lock = station_file.resolve().with_name(station_file.name + ".lock")
    return held(lock, f"station {station_file}")


def check_same(now: Header, then: Header) -> None:
    """Raise MP866 if a run would go on with something else than it began with."""
    for name in ("plan_sha256", "station", "seed", "faults", "camera"):
        if getattr(now, name) != getattr(then, name):
            raise ExecutorError(
                "MP866",
                f"{name} was {getattr(then, name)!r}, now it is {getattr(now, name)!r}",
            )
    for role in sorted({*now.devices, *then.devices}):
        was, is_now = then.devices.get(role, "none"), now.devices.get(role, "none")
        if was != is_now:
            raise ExecutorError(
                "MP866", f"the {role} was {was!r}, now it is {is_now!r}"
            )
