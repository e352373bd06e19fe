"""How long things take: wall time of calls and of whole processes."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence


def best_s(work: Callable[[], object], repeats: int) -> float:
    """Return the shortest of `repeats` wall times, s: the one least disturbed."""
    return min(once_s(work) for _ in range(repeats))


def once_s(work: Callable[[], object]) -> float:
    """Return the wall time of one call, s."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU time of one call, s: the wall time of one thread undisturbed."""
    start = time.process_time()
    work()
    return time.process_time() - start


def python_s(arguments: Sequence[str]) -> float:
    """Return the wall time of a fresh interpreter, s.

    Raises
    ------
    RuntimeError
        If it does not end with status 0.
    """
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False
    )
    taken = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{list(arguments)} ended with {done.returncode}:\n"
                           f"{done.stderr}")  # fmt: skip
    return taken
