"""Calls of devices, each with a time limit: one that hangs must not hang the run."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any, TypeVar

from executor.errors import ExecutorError

T = TypeVar("T")


@dataclass(slots=True)
class _Job:
    """One call on its way to the thread that makes it."""

    call: Callable[[], Any]
    late: Callable[[], None]  # made after the call if nobody waits for it any more
    done: threading.Lock = field(default_factory=threading.Lock)
    given_up: threading.Event = field(default_factory=threading.Event)
    value: Any = None
    error: Exception | None = None


class Caller:
    """Makes one call after the other in a thread of its own.

    A call that does not return in time is given up: its thread is left behind, and the
    next call gets a new one.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[_Job | None] | None = None

    def call(
        self,
        name: str,
        call: Callable[[], T],
        limit_s: float,
        late: Callable[[], None] = lambda: None,
    ) -> T:
        """Return what `call` returns.

        Parameters
        ----------
        name : str
            What the message calls it.
        call : callable
            The device call.
        limit_s : float
            By the machine's own clock, whatever the station's says.
        late : callable
            Made when a call that was given up, or interrupted, returns after all: a
            motion that it began late must not go on.

        Raises
        ------
        ExecutorError
            MP844 if it takes longer; MP841 if it raises.
        """
        job = _Job(call, late)
        job.done.acquire()
        self._queue().put(job)
        try:
            answered = job.done.acquire(timeout=limit_s)
        except BaseException:  # an interrupt: what the call begins must not go on
            self._give_up(job)
            raise
        if not answered:
            self._give_up(job)
            raise ExecutorError("MP844", f"{name} has not answered for {limit_s:g} s")
        if isinstance(job.error, ExecutorError):
            raise job.error
        if job.error is not None:
            kind = type(job.error).__name__
            raise ExecutorError("MP841", f"{name}: {kind}: {job.error}") from job.error
        value: T = job.value
        return value

    def _give_up(self, job: _Job) -> None:
        """Leave a call, and the thread that makes it, behind."""
        job.given_up.set()
        self._jobs = None

    def _queue(self) -> SimpleQueue[_Job | None]:
        """Return the queue of a thread that is free."""
        if self._jobs is None:
            self._jobs = SimpleQueue()
            threading.Thread(target=_work, args=(self._jobs,), daemon=True).start()
            weakref.finalize(self, self._jobs.put, None)
        return self._jobs


def _work(jobs: SimpleQueue[_Job | None]) -> None:
    """Make the calls of a queue until None comes, or one was given up."""
    while (job := jobs.get()) is not None:
        if job.given_up.is_set():
            return
        try:
            job.value = job.call()
        except Exception as error:  # noqa: BLE001 - a driver may raise anything
            job.error = error
        job.done.release()
        if job.given_up.is_set():
            job.late()
            return


def call_all(
    calls: Iterable[tuple[str, Callable[[], None]]], limit_s: float
) -> list[str]:
    """Make calls at the same time; return what went wrong, a line each.

    One that hangs or raises keeps no other from being made.
    """
    failed: dict[str, str] = {}
    threads = []
    for name, call in calls:
        failed[name] = f"{name} has not answered for {limit_s:g} s"
        thread = threading.Thread(target=_try, args=(name, call, failed), daemon=True)
        thread.start()
        threads.append(thread)
    for thread in threads:
        thread.join(limit_s)
    return [line for line in dict(failed).values() if line]


def _try(name: str, call: Callable[[], None], failed: dict[str, str]) -> None:
    """Make one call and note how it went."""
    try:
        call()
        failed[name] = ""
    except Exception as error:  # noqa: BLE001 - as above; the others must go on
        failed[name] = f"{name}: {type(error).__name__}: {error}"
