"""The queue done by processes of this machine."""

from __future__ import annotations

import heapq
import multiprocessing
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from multiprocessing.synchronize import Event
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import Any, Literal, TypeVar

from microplan.planner.queue.work_queue import (
    MOST_DEATHS,
    QueueLostError,
    WorkerDiedError,
)
from microplan.planner.queue.workers import StoppedError, listen

R = TypeVar("R")

_DIED = "workers died three times at the same work"  # `MOST_DEATHS`


@dataclass(slots=True, order=True)
class _Work:
    """A chunk and its handle, ordered as chunks are begun."""

    turn: tuple[float, int]
    chunk: Callable[[], Any] = field(compare=False)
    handle: Future[Any] = field(compare=False)
    begun: bool = field(default=False, compare=False)
    alone: bool = field(default=False, compare=False)  # under way at a death: suspected
    deaths: int = field(default=0, compare=False)  # while nothing else ran


class ProcessQueue:
    """A `WorkQueue` of processes, which end with this one; dead ones are replaced.

    One thread owns the pool and what waits: it makes the changes in `_inbox`. Of chunks
    that were under way when a process died one at a time is done again, alone.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs, self._turns = jobs, count()
        self._waiting: list[_Work] = []
        self._suspected: list[_Work] = []
        self._running: list[_Work] = []
        self._ended_by: Exception | None = None
        self._open = Lock()  # nothing is put after the last look into the inbox
        self._inbox: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._pool, self._unwanted = _started(jobs, None)
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def submit(self, chunk: Callable[[], R], priority: float = 0.0) -> Future[R]:
        """Return the handle of a chunk, as `WorkQueue.submit`."""
        handle: Future[R] = Future()
        work = _Work((-priority, next(self._turns)), chunk, handle)
        with self._open:
            if self._ended_by is not None:
                raise self._ended_by
            self._inbox.put(partial(heapq.heappush, self._waiting, work))
        return handle

    def close(self) -> None:
        """Take back what has not begun, and end what runs with its process."""
        self._inbox.put(None)
        self._thread.join()

    def _run(self) -> None:
        why: Exception = QueueLostError("what shares out the work has failed")
        try:
            while (change := self._inbox.get()) is not None:
                change()
                while (work := self._next()) is not None:
                    self._begin(work)
            why = StoppedError()
        except OSError as error:
            why = QueueLostError(f"a process cannot be started: {error}")
        finally:
            self._end(why)

    def _end(self, why: Exception) -> None:
        with self._open:
            self._ended_by = why
        try:
            self._unwanted.set()
            _stop(self._pool)
            for change in _rest(self._inbox):
                change()
        finally:
            for work in [*self._waiting, *self._suspected, *self._running]:
                _refuse(work, why)

    def _next(self) -> _Work | None:
        """Return what can be begun now."""
        if self._suspected:
            return None if self._running else self._suspected.pop()
        room = len(self._running) <= self._jobs  # one is on its way
        if not self._waiting or not room or any(work.alone for work in self._running):
            return None
        return heapq.heappop(self._waiting)

    def _begin(self, work: _Work) -> None:
        if not work.begun and not work.handle.set_running_or_notify_cancel():
            return
        work.begun, pool = True, self._pool
        self._running.append(work)
        try:
            done = pool.submit(work.chunk)
        except BrokenProcessPool:  # no news of it yet
            self._replace(pool)
            self._again(work)
            return
        ended = partial(self._ended, work, pool)
        done.add_done_callback(lambda done: self._inbox.put(partial(ended, done)))

    def _ended(self, work: _Work, pool: object, done: Future[Any]) -> None:
        error = StoppedError() if done.cancelled() else done.exception()
        if not isinstance(error, BrokenProcessPool):
            self._running.remove(work)
            _hand_on(work.handle, done, error)
            return
        self._replace(pool)
        work.deaths += work.alone
        work.alone = True
        self._again(work)

    def _again(self, work: _Work) -> None:
        """Let a chunk wait once more, unless workers always die at it."""
        self._running.remove(work)
        if work.deaths >= MOST_DEATHS:
            work.handle.set_exception(WorkerDiedError(_DIED))
        elif work.alone:
            self._suspected.append(work)
        else:
            heapq.heappush(self._waiting, work)

    def _replace(self, pool: object) -> None:
        if pool is self._pool and self._ended_by is None:
            self._pool, self._unwanted = _started(self._jobs, "spawn")


def _started(
    jobs: int, method: Literal["spawn"] | None
) -> tuple[ProcessPoolExecutor, Event]:
    """Return a pool with its first process running, and what stops its work.

    With threads under way processes are spawned: copies of this one could hold locks.
    """
    context = multiprocessing.get_context(method)
    unwanted = context.Event()
    pool = ProcessPoolExecutor(
        jobs, mp_context=context, initializer=listen, initargs=(unwanted,)
    )
    try:
        pool.submit(int)  # a pool that forks begins all its processes now
    except OSError:
        _stop(pool)
        raise
    return pool, unwanted


def _stop(pool: ProcessPoolExecutor) -> None:
    """End a pool and its own processes: what they are at is pure, wanted by nobody."""
    processes = getattr(pool, "_processes", None) or {}  # no public name before 3.14
    for process in list(processes.values()):
        process.terminate()
    pool.shutdown(cancel_futures=True)


def _refuse(work: _Work, why: Exception) -> None:
    """Say why a chunk is not done; one that has not begun may be taken back."""
    if isinstance(why, StoppedError):
        work.handle.cancel()
    if work.begun or work.handle.set_running_or_notify_cancel():
        work.handle.set_exception(why)


def _hand_on(
    handle: Future[Any], done: Future[Any], error: BaseException | None
) -> None:
    """Give a handle what its chunk came to."""
    if error is None:
        handle.set_result(done.result())
    else:
        handle.set_exception(error)


def _rest(inbox: SimpleQueue[Callable[[], None] | None]) -> list[Callable[[], None]]:
    """Return the changes that are left."""
    found: list[Callable[[], None]] = []
    while True:
        try:
            change = inbox.get_nowait()
        except Empty:
            return found
        if change is not None:
            found.append(change)
