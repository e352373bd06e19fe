"""One executor at a time: a lock that dies with the process that holds it."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from microplan.executor.devices.errors import ExecutorError, why

if sys.platform == "win32":  # pragma: no cover - there is no fcntl
    import msvcrt

    _FAR = 1 << 20  # a byte that nobody writes: what is locked cannot be read there

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
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ExecutorError("MP804", f"{path}: {why(error)}", place=path) from error
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
    """Put the holder's name into the file; a disk that is full keeps nobody out."""
    with suppress(OSError):
        os.ftruncate(number, 0)
        os.lseek(number, 0, os.SEEK_SET)
        os.write(number, text.encode())


def _holder(path: Path) -> str:
    """Return who holds a lock, as far as its file tells."""
    try:
        return path.read_text(encoding="utf-8").strip() or "another process"
    except (OSError, UnicodeDecodeError):
        return "another process"
