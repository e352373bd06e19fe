"""Speculative compilation of later looks in other processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures import wait as wait_for
from dataclasses import dataclass, field, replace
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.synchronize import Event
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import TypeVar

from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.control import tolerance_um
from microplan.planner.looks.coarse_to_fine import compile_looks
from microplan.planner.looks.compile_look import look_at_first
from microplan.planner.looks.look_problem import Begun, CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.looks.progress.work import (
    Counts,
    Stage,
    Work,
    count,
    images_of,
    own_counts,
)
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, insertion_after, requests
from microplan.planner.views.target_views import views
from microplan.planner.views.views import ViewPlan

A = TypeVar("A")
B = TypeVar("B")


_SAID_S = 0.2  # between two sayings of how far a look elsewhere has come


class StoppedError(Exception):
    """The result is not wanted any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _LookRequest:
    """What a look is compiled from, and whether it is only begun."""

    request: Request
    settings: tuple[ViewPlan, ...]
    current: float  # magnification of the microscope
    begun: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """What another process made of it."""

    looks: tuple[CompiledLook, ...]  # of all of it; none where it was only begun
    known: Begun  # what its beginning showed, where it was only begun
    findings: tuple[Diagnostic, ...]
    images: tuple[float, ...]  # that it made, by stage
    took_s: float


@dataclass(slots=True)
class Ahead:
    """Looks under way by the names of their requests. Changes no result.

    What a step asks for may depend on steps before it. What was compiled for another
    request, or from other views, is not used.
    """

    under_way: dict[str, tuple[_LookRequest, Future[_Made]]] = field(
        default_factory=dict
    )
    elsewhere_s: float = 0.0  # what others worked while this process waited, and more
    work: Work = field(default_factory=Work)

    def looks(
        self,
        task: Task,
        request: Request,
        context: CompileContext,
        current: float,
        report: Report,
    ) -> tuple[CompiledLook, ...]:
        """Return the looks of a request, as `coarse_to_fine.compile_looks` does."""
        context = replace(context, told=self.work.told(request.id))
        found = self._looks(task, request, context, current, report)
        self.work.ended(request.id)
        return found

    def _looks(
        self,
        task: Task,
        request: Request,
        context: CompileContext,
        current: float,
        report: Report,
    ) -> tuple[CompiledLook, ...]:
        """Return the looks of a request, from elsewhere if they are under way."""
        asked, future = self.under_way.pop(request.id, (None, None))
        if asked is None or future is None:
            return compile_looks(task, request, context, current, report)
        if not _serves(asked, task, request, current):
            future.cancel()
            return compile_looks(task, request, context, current, report)
        started = time.perf_counter()
        while not wait_for([future], _SAID_S).done:
            self.work.say()
        made = future.result()
        self.work.counted(request.id, made.images)
        self.elsewhere_s += made.took_s - (time.perf_counter() - started)
        if asked.begun:
            return compile_looks(
                task, request, context, current, report, known=made.known
            )
        report.found += made.findings
        return made.looks


def begin(
    pool: Executor,
    task: Task,
    states: tuple[StepState, ...],
    context: CompileContext,
    current: float,
    work: Work | None = None,
) -> Ahead:
    """Start on all looks that steps will probably ask for, the largest first.

    A look whose tolerance depends on the looks before it is only begun: evaluated once,
    and the part's other features if that result wants them.
    """
    work = work or Work()
    found = plan_work(work, task, states, context, current)
    under_way = {}
    alone = replace(context, map=until_told)
    for asked in sorted(found, key=lambda asked: (not asked.begun, -_area(asked))):
        number = work.number(asked.request.id)
        future = pool.submit(_make, task, asked, alone, number)
        under_way[asked.request.id] = asked, future
    return Ahead(under_way=under_way, work=work)


def plan_work(
    work: Work,
    task: Task,
    states: tuple[StepState, ...],
    context: CompileContext,
    current: float,
) -> list[_LookRequest]:
    """Return what all steps ask for if looks before them change nothing: the work."""
    found = [
        asked
        for index in range(len(states))
        for asked in _probable(task, states, index, current)
    ]
    work.plan([asked.request.id for asked in found], context.effort)
    return found


def until_told(function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
    """Yield `function` of each item; StoppedError once the results are not wanted."""
    for item in items:
        if _unwanted is not None and _unwanted.is_set():
            raise StoppedError
        yield function(item)


def listen(unwanted: Event, counts: Counts | None = None) -> None:
    """Set the event that stops this process, and end it with the one that began it.

    Ctrl-C is for that one, which then sets the event. Images are counted in `counts`.

    A pool's processes do not notice when that is killed: each waits for the next task
    on a pipe that the others hold open.
    """
    # a pool's processes are told things in this way
    global _unwanted, _counts
    _unwanted, _counts = unwanted, counts
    parent = parent_process()
    if parent is not None:
        signal(SIGINT, SIG_IGN)
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when another one does."""
    wait([sentinel])
    os._exit(1)


_unwanted: Event | None = None
_counts: Counts | None = None


def _probable(
    task: Task, states: tuple[StepState, ...], index: int, current: float
) -> Iterator[_LookRequest]:
    """Yield what a step asks for if looks before it change nothing."""
    here, within_um = states[index], None
    begun = False
    if here.step.verb == "align":
        within_um = tolerance_um(task, states, here, None)
        begun = insertion_after(states, here) is not None
    for request in requests(task, states, index, within_um):
        settings = views(task, request, current, Report())
        if settings:
            yield _LookRequest(
                request=request,
                settings=tuple(settings),
                current=current,
                begun=begun,
            )


def _area(asked: _LookRequest) -> int:
    """Return the pixels of a look's region."""
    region = asked.settings[0].region
    return region.rows * region.columns


def _serves(asked: _LookRequest, task: Task, request: Request, current: float) -> bool:
    """Return whether what was asked for is what is wanted, or begins like it."""
    bare = request
    if asked.begun:
        bare = replace(request, admissible_um=None, break_even_um=None)
    settings: Sequence[ViewPlan] = views(task, request, current, Report())
    return asked.request == bare and asked.settings == tuple(settings)


def _make(
    task: Task, asked: _LookRequest, context: CompileContext, number: int
) -> _Made:
    """Compile a look, or begin to; its images count under its number, too."""
    started, report, known = time.perf_counter(), Report(), Begun()
    own = own_counts(1)

    def told(stage: Stage, images: float) -> None:
        count(own, 0, stage, images)
        if _counts is not None:
            count(_counts, number, stage, images)

    context = replace(context, told=told)
    looks: tuple[CompiledLook, ...] = ()
    if asked.begun:
        look_at_first(task, asked.request, context, asked.settings[0], known)
    else:
        looks = compile_looks(task, asked.request, context, asked.current, report)
    return _Made(
        looks=looks,
        known=known,
        findings=tuple(report.found),
        images=images_of(own, 0),
        took_s=time.perf_counter() - started,
    )
