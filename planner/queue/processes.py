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
from threading import Thread
from typing import Any, Literal, TypeVar

from microplan.planner.queue.work_queue import MOST_DEATHS, WorkerDiedError
from microplan.planner.queue.workers import StoppedError, listen

R = TypeVar("R")


@dataclass(slots=True, order=True)
class _Work:
    """A chunk and its handle, ordered as chunks are begun."""

    turn: tuple[float, int]
    chunk: Callable[[], Any] = field(compare=False)
    handle: Future[Any] = field(compare=False)
    begun: bool = field(default=False, compare=False)
    deaths: int = field(default=0, compare=False)


class ProcessQueue:
    """A `WorkQueue` of processes, which end with this one; dead ones are replaced.

    One thread owns the pool and what waits: it makes the changes in `_inbox`.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs, self._running, self._turns = jobs, 0, count()
        self._closed, self._others = False, set(multiprocessing.active_children())
        self._waiting: list[_Work] = []
        self._inbox: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._pool, self._unwanted = _started(jobs, None)
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def submit(self, chunk: Callable[[], R], priority: float = 0.0) -> Future[R]:
        """Return the handle of a chunk, as `WorkQueue.submit`."""
        if self._closed:
            raise StoppedError
        handle: Future[R] = Future()
        work = _Work((-priority, next(self._turns)), chunk, handle)
        self._inbox.put(partial(heapq.heappush, self._waiting, work))
        return handle

    def close(self) -> None:
        """Take back what has not begun, and end what runs with its process."""
        self._inbox.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (change := self._inbox.get()) is not None:
            change()
            while self._waiting and self._running <= self._jobs:  # one on its way
                self._begin(heapq.heappop(self._waiting))
        self._closed = True
        self._unwanted.set()
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()  # what it is at is pure, and wanted by nobody
        self._pool.shutdown(cancel_futures=True)
        for change in _rest(self._inbox):
            change()
        for work in self._waiting:
            if not work.handle.cancel():
                work.handle.set_exception(StoppedError())

    def _begin(self, work: _Work) -> None:
        if not work.begun and not work.handle.set_running_or_notify_cancel():
            return
        work.begun, pool = True, self._pool
        try:
            done = pool.submit(work.chunk)
        except BrokenProcessPool:  # no news of it yet
            self._replace(pool)
            heapq.heappush(self._waiting, work)
            return
        self._running += 1
        ended = partial(self._ended, work, pool)
        done.add_done_callback(lambda done: self._inbox.put(partial(ended, done)))

    def _ended(self, work: _Work, pool: object, done: Future[Any]) -> None:
        self._running -= 1
        error = StoppedError() if done.cancelled() else done.exception()
        if not isinstance(error, BrokenProcessPool):
            _hand_on(work.handle, done, error)
            return
        self._replace(pool)
        work.deaths += 1
        if work.deaths < MOST_DEATHS:
            heapq.heappush(self._waiting, work)
        else:
            work.handle.set_exception(WorkerDiedError(f"{work.chunk}"))

    def _replace(self, pool: object) -> None:
        if pool is self._pool and not self._closed:
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
    pool.submit(int)  # a pool that forks begins all its processes now
    return pool, unwanted


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
