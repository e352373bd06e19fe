"""Saved files of a task: their contents differ from what was read."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path

MOST_BYTES = 1 << 24  # of an input file; larger ones are never read by a compile
POLL_S = 0.25  # between two readings: soon enough for a person, and no load
# An editor that moves a file away and a new one into its place leaves none for a
# moment; a file that is gone for longer is missing.
GONE_S = 2.0


def file_sha256(path: str) -> str | None:
    """Return the digest of a file, None if there is none that a compile could read."""
    try:
        if not Path(path).is_file():  # a pipe might wait for ever
            return None
        with Path(path).open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError):
        return None
    return None if len(data) > MOST_BYTES else hashlib.sha256(data).hexdigest()


def next_saved(
    known: Mapping[str, str | None], wait: Callable[[float], None] = time.sleep
) -> tuple[str, ...]:
    """Return the files that hold something else than what is known, once some do.

    They must not have changed since the reading before, so that what an editor writes
    in pieces counts when it is whole. `known` are digests by path, None for no file;
    `wait` waits some seconds.
    """
    seen: dict[str, str | None] = {}
    gone_s = 0.0
    while True:
        now = {path: file_sha256(path) for path in sorted(known)}
        gone = any(now[path] is None and known[path] is not None for path in now)
        if now == seen and not (gone and gone_s < GONE_S):
            saved = tuple(path for path in now if now[path] != known[path])
            if saved:
                return saved
        seen = now
        gone_s = gone_s + POLL_S if gone else 0.0
        wait(POLL_S)
