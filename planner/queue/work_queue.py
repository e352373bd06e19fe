"""The queue of chunks that all adapters implement, and its map that keeps order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, Protocol, TypeVar

A = TypeVar("A")
B = TypeVar("B")
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


def mapping(
    queue: WorkQueue, priority: float = 0.0
) -> Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]:
    """Return a `map` whose calls are chunks of a queue; all are handed over at once."""

    def mapped(function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
        work = [queue.submit(partial(function, item), priority) for item in items]
        return _in_order(work)

    return mapped


def _in_order(work: Sequence[Future[R]]) -> Iterator[R]:
    """Yield results in the order of their chunks; take the rest back at an end."""
    left = list(reversed(work))  # popped: a result that was used is not kept
    try:
        while left:
            yield left.pop().result()
    finally:
        for each in left:
            each.cancel()
