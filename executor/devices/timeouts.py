"""Device calls with a time limit: one that hangs must not hang the run."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any, TypeVar

from microplan.executor.devices.errors import ExecutorError


class WallClock:
    """Seconds since it was made, by the machine's monotonic clock."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def now_s(self) -> float:
        """Return seconds since the clock was made."""
        return time.monotonic() - self._began_s

    def wait(self, seconds: float) -> None:
        """Sleep for `seconds`."""
        time.sleep(max(seconds, 0.0))


T = TypeVar("T")


@dataclass(slots=True)
class _PendingCall:
    """Call of a device, passed to the thread that makes it."""

    name: str
    call: Callable[[], Any]
    # made after the call if it was given up
    late: Callable[[], None] | None
    done: threading.Lock = field(default_factory=threading.Lock)
    given_up: threading.Event = field(default_factory=threading.Event)
    value: Any = None
    error: BaseException | None = None
    late_error: BaseException | None = None


_Jobs = SimpleQueue[_PendingCall | None]


class Caller:
    """Makes one call after the other in a thread of its own.

    A call that does not return in time is given up: its thread is left behind, and the
    next call gets a new one.
    """

    def __init__(self) -> None:
        self._worker: tuple[_Jobs, threading.Thread] | None = None
        # given up, and able to begin a motion
        self._left: list[tuple[_PendingCall, threading.Thread]] = []

    def call(
        self,
        name: str,
        call: Callable[[], T],
        limit_s: float,
        late: Callable[[], None] | None = None,
    ) -> T:
        """Return the result of `call`.

        Parameters
        ----------
        name : str
            What the message calls it.
        call : callable
            The device call.
        limit_s : float
            By the machine's own clock, not the station's.
        late : callable
            Made when a call that was given up, or interrupted, returns after all: a
            motion that it began late must not go on. `settle` waits for it.

        Raises
        ------
        ExecutorError
            MP844 if it takes longer; MP841 if it raises.
        """
        job = _PendingCall(name, call, late)
        job.done.acquire()
        jobs = self._queue()
        try:
            jobs.put(job)
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
            raise ExecutorError("MP841", f"{name}: {reason(job.error)}") from job.error
        value: T = job.value
        return value

    def settle(self, limit_s: float) -> list[str]:
        """Wait for motions whose calls were given up; return what is left of them.

        Their threads end with the process: without this a motion that begins late
        would not be stopped any more.
        """
        for _, thread in self._left:
            thread.join(limit_s)
        self._left = [(job, t) for job, t in self._left if t.is_alive() or _why(job)]
        return [
            _why(job)
            or f"{job.name} has not returned: what it begins will not be stopped"
            for job, _ in self._left
        ]

    def _give_up(self, job: _PendingCall) -> None:
        """Leave a call, and the thread that makes it, behind."""
        job.given_up.set()
        worker, self._worker = self._worker, None
        if worker is None:
            return
        jobs, thread = worker
        jobs.put(None)  # an interrupt may have kept the job itself from being put
        if job.late is not None:
            self._left.append((job, thread))

    def _queue(self) -> _Jobs:
        """Return the queue of a thread that is free."""
        if self._worker is None:
            jobs: _Jobs = SimpleQueue()
            thread = threading.Thread(target=_work, args=(jobs,), daemon=True)
            thread.start()
            self._worker = jobs, thread
            weakref.finalize(self, jobs.put, None)
        return self._worker[0]


def reason(error: BaseException) -> str:
    """Return kind and message of what a driver raised, as far as it has one."""
    kind = type(error).__name__
    try:
        return f"{kind}: {error}"
    except Exception as other:  # noqa: BLE001 - a driver's class may do what it likes
        return f"{kind}, whose words raise {type(other).__name__}"


def _why(job: _PendingCall) -> str:
    """Return what went wrong with the stop of a motion that began late."""
    error = job.late_error
    if error is None:
        return ""
    return f"{job.name} returned late, its stop: {reason(error)}"


def _work(jobs: _Jobs) -> None:
    """Make the calls of a queue until None comes, or one was given up."""
    while (job := jobs.get()) is not None:
        if job.given_up.is_set():
            return
        try:
            job.value = job.call()
        except BaseException as error:  # noqa: BLE001 - a driver may raise anything
            job.error = error
        job.done.release()
        if job.given_up.is_set():
            _stop(job)
            return


def _stop(job: _PendingCall) -> None:
    """Undo what a call began that was given up."""
    if job.late is None:
        return
    try:
        job.late()
    except BaseException as error:  # noqa: BLE001 - as above; `settle` reports it
        job.late_error = error


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
    except BaseException as error:  # noqa: BLE001 - as above; the others must go on
        failed[name] = f"{name}: {reason(error)}"
