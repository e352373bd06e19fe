"""Threads that feed one queue, of which one runs at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from threading import RLock
from typing import Protocol, TypeVar

from microplan.planner.queue.work_queue import WorkQueue

A = TypeVar("A")
B = TypeVar("B")
R = TypeVar("R")


class ChunkMap(Protocol):
    """As `map` of one iterable."""

    def __call__(
        self, function: Callable[[A], B], items: Iterable[A], /
    ) -> Iterator[B]:
        """Yield results in the order of their items."""
        ...


@dataclass(slots=True)
class Elsewhere:
    """What workers did for a thread, less what the thread waited."""

    seconds: float = 0.0


class Turns:
    """Control flows that share a queue; each runs until it waits for chunks.

    So they need no locks, and nothing that they share has to be safe in threads. The
    thread that opens this has its turn until `close`.
    """

    def __init__(self, queue: WorkQueue, most: int) -> None:
        self._queue, self._turn = queue, RLock()
        self._threads = ThreadPoolExecutor(most)
        self._turn.acquire()

    def start(self, work: Callable[[], R]) -> Future[R]:
        """Return what will come of a control flow that has its turns; `of` waits."""
        return self._threads.submit(self._run, work)

    def of(self, found: Future[R]) -> R:
        """Return a result when it is there; others have their turn till then."""
        if not found.done():
            with self._others():
                return found.result()
        return found.result()

    def map(self, priority: float, elsewhere: Elsewhere) -> ChunkMap:
        """Return a `map` whose calls are chunks of the queue, all handed over at once.

        `elsewhere` counts what they take.
        """

        def mapped(function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
            calls = [partial(_timed, function, item) for item in items]
            work = [self._queue.submit(call, priority) for call in calls]
            return self._in_order(list(reversed(work)), elsewhere)

        return mapped

    def close(self) -> None:
        """Let control flows end: the queue is closed, they wait for it in vain.

        The thread that opened this may have no turn: Ctrl-C came while others had it.
        """
        with suppress(RuntimeError):
            self._turn.release()
        self._threads.shutdown(cancel_futures=True)

    def _in_order(
        self, left: list[Future[tuple[float, R]]], elsewhere: Elsewhere
    ) -> Iterator[R]:
        """Yield results, the last first; take the rest back at an end."""
        try:
            while left:
                started = time.perf_counter()
                took_s, found = self.of(left.pop())
                waited_s = time.perf_counter() - started
                elsewhere.seconds += took_s - waited_s
                yield found
        finally:
            for each in left:
                each.cancel()

    def _run(self, work: Callable[[], R]) -> R:
        with self._turn:
            return work()

    @contextmanager
    def _others(self) -> Iterator[None]:
        self._turn.release()
        try:
            yield
        finally:
            self._turn.acquire()


def _timed(function: Callable[[A], B], item: A) -> tuple[float, B]:
    """Return how long a call takes, and what it gives."""
    started = time.perf_counter()
    found = function(item)
    return time.perf_counter() - started, found
