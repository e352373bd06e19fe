"""The queue done by the workers of a Dask scheduler, through `microplan[cluster]`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from microplan.planner.queue.work_queue import QueueLostError, WorkerDiedError
from microplan.planner.queue.workers import unwanted_when

if TYPE_CHECKING:
    import distributed

R = TypeVar("R")

_END_S = 2.0  # for a good-bye
_ONE_AT_A_TIME = Lock()  # chunks are made for processes, a worker may have threads
WAIT_S = 10.0  # for an answer of the scheduler: a network's delay is far below


class ClusterQueue:
    """A `WorkQueue` of a Dask cluster, whose scheduler gives lost chunks away again.

    Raises QueueLostError where no scheduler answers at an address in time, and
    ImportError without Dask.
    """

    def __init__(self, address: str, wait_s: float = WAIT_S) -> None:
        from distributed import Client

        try:
            asyncio.run(_reached(address, wait_s))
            self._client = Client(address, timeout=wait_s, set_as_default=False)
        except Exception as error:  # also what Dask makes of others' answers
            raise QueueLostError(f"{address}: {error}") from error

    def submit(self, chunk: Callable[[], R], priority: float = 0.0) -> Future[R]:
        """Return the handle of a chunk, as `WorkQueue.submit`; all can be cancelled."""
        handle: Future[R] = Future()
        try:
            done = self._client.submit(_done, chunk, priority=priority, pure=False)
        except (OSError, RuntimeError) as error:
            raise QueueLostError(str(error)) from error
        handle.add_done_callback(lambda each: done.cancel() if each.cancelled() else 0)
        done.add_done_callback(lambda done: _hand_on(handle, done))
        return handle

    def each_worker(self, function: Callable[[], R]) -> Mapping[str, R | BaseException]:
        """Return what a function gives on every worker by its address, or its error."""
        found: Mapping[str, R | BaseException] = self._client.run(
            function, on_error="return"
        )
        return found

    def close(self) -> None:
        """Take everything back, and leave the scheduler as it was."""
        self._client.close(timeout=_END_S)


async def _reached(address: str, wait_s: float) -> None:
    """Raise unless a Dask server answers; a client that fails would wait once more."""
    from distributed.comm import connect

    comm = await connect(address, timeout=wait_s)
    await comm.close()


def _done(chunk: Callable[[], R]) -> R:
    """Return what a chunk comes to; on a worker, which may be told to forget it."""
    from distributed import get_worker

    worker = get_worker()
    tasks, key = worker.state.tasks, worker.get_current_task()
    unwanted_when(lambda: key not in tasks or tasks[key].state == "cancelled")
    with _ONE_AT_A_TIME:
        return chunk()


def _hand_on(handle: Future[Any], done: distributed.Future) -> None:
    """Give a handle what its chunk came to on the cluster."""
    from distributed import KilledWorker

    if not handle.set_running_or_notify_cancel():
        return
    try:
        if done.status == "cancelled":  # not by us
            raise QueueLostError("the scheduler forgot a chunk, or is gone")
        handle.set_result(done.result())
    except KilledWorker:
        handle.set_exception(WorkerDiedError("workers died each time at the same work"))
    except Exception as error:  # the chunk's own, whatever it is
        handle.set_exception(error)
