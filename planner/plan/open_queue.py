"""The queue that a call asks for: processes of this machine, or a cluster."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from signal import SIG_DFL, SIG_IGN, SIGINT, getsignal, signal
from threading import current_thread, main_thread
from typing import Any, TypeVar, cast

import numpy as np

from microplan.planner.queue.cluster import ClusterQueue
from microplan.planner.queue.processes import ProcessQueue
from microplan.planner.queue.turns import Turns
from microplan.planner.queue.work_queue import (
    QueueLostError,
    WorkerDiedError,
    WorkQueue,
)
from microplan.planner.source.diagnostics import CallError, Report, Span
from microplan.planner.store.memo import sources

R = TypeVar("R")

CLUSTER = "MP731"
_FEWER = "fewer --jobs need less memory"
_MOST_LOOKS = 8  # under way at a time, however many workers there are
_ONE_THREAD = "OMP_NUM_THREADS"  # as the command sets it, and Dask for its workers


class SchedulerError(CallError):
    """A scheduler or its workers cannot be used."""

    def __init__(self, address: str, message: str, hint: str) -> None:
        super().__init__(CLUSTER, message, address, hint)


class OtherVersionError(Exception):
    """A worker computes something else."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerKind:
    """What a worker's results depend on besides the chunk."""

    version: str
    sources: str  # digest of all that computes
    cpu: str  # results of another kind may differ in their last digits


def own_kind() -> WorkerKind:
    """Return the kind of this process."""
    found: Mapping[str, Any] = cast(Any, np.show_config)(mode="dicts")
    extensions = found.get("SIMD Extensions", {}).get("found", ())
    threads = os.environ.get(_ONE_THREAD, "all")
    words = (platform.system(), platform.machine(), *extensions, f"threads={threads}")
    return WorkerKind(
        version=version("microplan"), sources=sources(), cpu=" ".join(words)
    )


@contextmanager
def opened(jobs: int, scheduler: str | None) -> Iterator[WorkQueue | None]:
    """Yield the queue that is asked for, None for this process alone; it ends after.

    Raises
    ------
    SchedulerError
        MP731 if the scheduler does not answer, or lacks workers of this version; if
        processes cannot be started, or die each time at the same work.
    """
    if scheduler is None and jobs <= 1:
        yield None
        return
    queue = _processes(jobs) if scheduler is None else cluster(scheduler)
    try:
        yield queue
    except (QueueLostError, OtherVersionError) as error:
        hint = "what was done is kept; call again once it runs"
        lost = f"lost the queue: {error}"
        raise SchedulerError(
            scheduler or "", lost, hint if scheduler else _FEWER
        ) from None
    except WorkerDiedError as error:
        hint = "workers with more memory may do it" if scheduler else _FEWER
        raise SchedulerError(scheduler or "", str(error), hint) from None
    finally:
        queue.close()


@contextmanager
def turns_of(
    jobs: int, scheduler: str | None, report: Report
) -> Iterator[Turns | None]:
    """Yield turns at the queue that is asked for, None for this process alone.

    MP731 says which workers have another kind of processor.
    """
    with opened(jobs, scheduler) as queue:
        if queue is None:
            yield None
            return
        if isinstance(queue, _SameSources):
            _report_others(queue, scheduler or "", report)
        turns = Turns(queue, _MOST_LOOKS if scheduler else min(jobs + 1, _MOST_LOOKS))
        on_interrupt = getsignal(SIGINT)
        try:
            yield turns
        finally:
            try:
                _on_interrupt(SIG_IGN)  # flows end only if all is closed
            finally:
                try:
                    queue.close()  # who waits for chunks ends
                finally:
                    turns.close()
                    _on_interrupt(on_interrupt)


def _on_interrupt(handler: Any) -> None:
    """Set what Ctrl-C does, which the main thread alone can."""
    if current_thread() is main_thread():
        signal(SIGINT, SIG_DFL if handler is None else handler)


def _processes(jobs: int) -> WorkQueue:
    """Return a queue of processes, if they can be started."""
    try:
        return ProcessQueue(jobs)
    except OSError as error:
        message = f"a process cannot be started: {error}"
        raise SchedulerError("", message, _FEWER) from error


def cluster(address: str) -> WorkQueue:
    """Return the queue of a scheduler whose workers all compute what we would."""
    try:
        queue = ClusterQueue(address)
    except ImportError as error:
        hint = "install microplan[cluster]"
        raise SchedulerError(address, "--scheduler needs Dask", hint) from error
    except QueueLostError as error:
        hint = "start one with 'dask scheduler', and workers with 'dask worker ADDRESS'"
        raise SchedulerError(address, f"no scheduler answers: {error}", hint) from error
    try:
        kinds = queue.each_worker(own_kind)
        _check_workers(kinds, address)
    except BaseException:
        queue.close()
        raise
    cpu = own_kind().cpu
    found = {w: k.cpu for w, k in kinds.items() if isinstance(k, WorkerKind)}
    return _SameSources(queue, {w: other for w, other in found.items() if other != cpu})


def _report_others(queue: _SameSources, address: str, report: Report) -> None:
    """Report workers whose results may differ from those of this machine."""
    for kind in sorted(set(queue.others.values())):
        names = [worker for worker, other in queue.others.items() if other == kind]
        report.note(
            CLUSTER,
            Span(file=address),
            f"{len(names)} workers have {kind}, here is {own_kind().cpu}: the plan's "
            "numbers may differ in their last digits; nothing is kept in the cache",
            "workers of one kind of processor give the same bytes",
        )


class _SameSources:
    """A queue whose workers, also those that come later, refuse other sources."""

    def __init__(self, queue: WorkQueue, others: Mapping[str, str]) -> None:
        self._queue = queue
        self.others = others  # workers of another processor, and its kind

    def submit(self, chunk: Callable[[], R], priority: float = 0.0) -> Future[R]:
        return self._queue.submit(partial(_if_same, sources(), chunk), priority)

    def close(self) -> None:
        self._queue.close()


def _if_same(known: str, chunk: Callable[[], R]) -> R:
    """Return what a chunk comes to, unless its results would be of other sources."""
    if sources() != known:
        raise OtherVersionError(f"a worker has microplan {version('microplan')}, "
                                f"{sources()[:12]}, here is {known[:12]}")  # fmt: skip
    return chunk()


def _check_workers(
    kinds: Mapping[str, WorkerKind | BaseException], address: str
) -> None:
    """Refuse a cluster without workers, or with one that computes something else."""
    own = own_kind()
    if not kinds:
        hint = f"start some: dask worker {address}"
        raise SchedulerError(address, "the scheduler has no workers", hint)
    for worker, kind in sorted(kinds.items()):
        if not isinstance(kind, WorkerKind):
            said = f"cannot tell its version: {type(kind).__name__}: {kind}"
        elif kind.sources != own.sources:
            said = f"has microplan {kind.version}, {kind.sources[:12]}"
        else:
            continue
        raise SchedulerError(
            address,
            f"worker {worker} {said}; here is {own.version}, {own.sources[:12]}",
            "install the same microplan, Python and libraries for every worker",
        )
