"""Cached results by their keys: whole or absent, verified when read, bounded."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

MOST_BYTES = 1 << 30  # of all results together: a gibibyte
_SUM = 32  # bytes of a sha256, before the result
_SUFFIX = ".result"
_BEGUN = ".begun-"  # of files that are being written
_DEAD_S = 86400.0  # a result is written in seconds; what is older nobody finishes
_MOST_LOOKED_AT = 10_000  # files begun, by one trim


def place() -> Path:
    """Return where results are kept unless a user says otherwise."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(stated) if stated.startswith("/") else Path.home() / ".cache"
    return home / "microplan"


@dataclass(frozen=True, slots=True)
class Store:
    """Results in one folder; several processes may use it at the same time.

    What cannot be read or written counts as absent: a cache never stops a compile.
    """

    folder: Path
    most_bytes: int = MOST_BYTES

    def get(self, key: str) -> bytes | None:
        """Return the result kept under a key, None if there is none that is whole."""
        file = self._file(key)
        try:
            data = file.read_bytes()
        except OSError:
            return None
        found = data[_SUM:]
        if hashlib.sha256(key.encode() + found).digest() != data[:_SUM]:
            with contextlib.suppress(OSError):
                file.unlink()
            return None
        with contextlib.suppress(OSError):
            os.utime(file)  # used just now: among the last to be forgotten
        return found

    def put(self, key: str, result: bytes) -> None:
        """Keep a result; the one used least recently goes when there is no room."""
        if len(result) + _SUM > self.most_bytes:
            return
        file = self._file(key)
        check = hashlib.sha256(key.encode() + result).digest()
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(prefix=_BEGUN, dir=file.parent)
        except OSError:
            return
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(check + result)
            Path(name).replace(file)
        except OSError:
            with contextlib.suppress(OSError):
                Path(name).unlink()

    def trim(self) -> None:
        """Forget what was not used for longest until the rest fits.

        What killed processes began to write and left goes too, a day later.
        """
        self._clear()
        kept = []
        for file in self.folder.glob(f"*/*{_SUFFIX}"):
            with contextlib.suppress(OSError):
                stat = file.stat()
                kept.append((stat.st_mtime_ns, file.name, stat.st_size, file))
        total = sum(size for _, _, size, _ in kept)
        for _, _, size, file in sorted(kept):
            if total <= self.most_bytes:
                return
            with contextlib.suppress(OSError):
                file.unlink()
            total -= size

    def _clear(self) -> None:
        """Remove what was begun more than a day ago: its writer is dead, or fails."""
        oldest_s = time.time() - _DEAD_S
        for file in islice(
            self.folder.glob(f"[0-9a-f][0-9a-f]/{_BEGUN}*"), _MOST_LOOKED_AT
        ):
            with contextlib.suppress(OSError):
                if file.lstat().st_mtime < oldest_s:
                    file.unlink()

    def _file(self, key: str) -> Path:
        """Return where a key's result is; keys are hexadecimal digests."""
        if not key or set(key) - set("0123456789abcdef"):
            raise ValueError(f"a key is a hexadecimal digest, got {key!r}")
        return self.folder / key[:2] / (key[2:] + _SUFFIX)
