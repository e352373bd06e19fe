"""The queue of chunks that all adapters implement."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

R = TypeVar("R")

MOST_DEATHS = 3  # of workers at one chunk, which then is taken for the cause


class WorkerDiedError(Exception):
    """Workers died each time at the same chunk."""


class QueueLostError(Exception):
    """What does the work cannot be reached any more."""


class WorkQueue(Protocol):
    """Chunks done by any worker, the most urgent first; safe to use from any thread.

    A chunk is a picklable function without arguments, as a `functools.partial`. It is
    done again where its worker dies, so it must be pure.
    """

    def submit(self, chunk: Callable[[], R], priority: float = 0.0) -> Future[R]:
        """Return the handle of a chunk; the highest priority is begun first.

        Of equals the first is. `cancel` of the handle takes a chunk back that has not
        begun; `concurrent.futures.as_completed` yields handles as they are done. After
        `close` nothing may be submitted.
        """
        ...

    def close(self) -> None:
        """Take back what has not begun, and let nothing run on."""
        ...
