"""Speculative compilation of later looks, whose chunks share one queue."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial

from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.control import tolerance_um
from microplan.planner.looks.coarse_to_fine import compile_looks
from microplan.planner.looks.compile_look import look_at_first
from microplan.planner.looks.look_problem import Begun, CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.looks.progress.work import Work
from microplan.planner.queue.turns import Elsewhere, Turns
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, insertion_after, requests
from microplan.planner.views.target_views import views
from microplan.planner.views.views import ViewPlan


@dataclass(frozen=True, slots=True, kw_only=True)
class _LookRequest:
    """What a look is compiled from, and whether it is only begun."""

    request: Request
    settings: tuple[ViewPlan, ...]
    current: float  # magnification of the microscope
    begun: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """What was made of it."""

    looks: tuple[CompiledLook, ...]  # of all of it; none where it was only begun
    known: Begun  # what its beginning showed, where it was only begun
    findings: tuple[Diagnostic, ...]
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
    turns: Turns | None = None
    elsewhere: Elsewhere = field(default_factory=Elsewhere)
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
        """Return the looks of a request, those under way if they serve."""
        asked, future = self.under_way.pop(request.id, (None, None))
        if asked is None or future is None or self.turns is None:
            return compile_looks(task, request, context, current, report)
        if not _serves(asked, task, request, current):
            future.cancel()
            return compile_looks(task, request, context, current, report)
        started = time.perf_counter()
        made = self.turns.of(future)
        self.elsewhere.seconds += made.took_s - (time.perf_counter() - started)
        if asked.begun:
            return compile_looks(
                task, request, context, current, report, known=made.known
            )
        report.found += made.findings
        return made.looks


def begin(
    turns: Turns,
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
    found.sort(key=lambda asked: (not asked.begun, -_area(asked)))
    under_way = {}
    for turn, asked in enumerate(found):
        own = replace(context, told=work.counting(asked.request.id))
        make = partial(_make, task, asked, own, turns, float(-turn))
        under_way[asked.request.id] = asked, turns.start(make)
    return Ahead(under_way=under_way, turns=turns, work=work)


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
    task: Task,
    asked: _LookRequest,
    context: CompileContext,
    turns: Turns,
    priority: float,
) -> _Made:
    """Compile a look, or begin to."""
    started, report, known = time.perf_counter(), Report(), Begun()
    elsewhere = Elsewhere()
    context = replace(context, map=turns.map(priority, elsewhere))
    looks: tuple[CompiledLook, ...] = ()
    if asked.begun:
        look_at_first(task, asked.request, context, asked.settings[0], known)
    else:
        looks = compile_looks(task, asked.request, context, asked.current, report)
    return _Made(
        looks=looks,
        known=known,
        findings=tuple(report.found),
        took_s=time.perf_counter() - started + elsewhere.seconds,
    )
