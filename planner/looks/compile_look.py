"""One look compiled: at which magnification, by its target alone or by several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.featuresel.selection.evaluate import is_fit
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.feature_evaluation import Races
from microplan.planner.looks.feature_sets import (
    FeatureSetResult,
    FeatureSetSearch,
    wanted,
)
from microplan.planner.looks.look_problem import (
    Begun,
    CompileContext,
    LookProblem,
    TargetResult,
)
from microplan.planner.looks.look_record import (
    CompiledLook,
    LookDecision,
    compiled,
    measured,
)
from microplan.planner.looks.records import commonest_hint, rejections
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import marks_view, views, whole_view
from microplan.planner.views.views import ViewPlan
from microplan.schemas.plan.views import ZoomTried

BORNE = "what the insertion bears at this magnification"
WORTH = "the best here: another zoom would cost the insertion more"
NEAR = 1.05  # of the best need, so that new draws of the same chain keep it


@dataclass(frozen=True, slots=True, kw_only=True)
class _Refused:
    """A magnification at which nothing found was good enough."""

    view: ViewPlan
    tried: Evaluation
    advice: str
    fit: bool  # the target is seen, and its angle can be told


def compile_look(
    task: Task,
    request: Request,
    effects: CompileContext,
    current: float,
    report: Report,
    *,
    once: bool = False,
    known: Begun | None = None,
) -> CompiledLook | None:
    """Return the look, None if there is a reason why it cannot be done.

    Magnifications are tried in order of preference until a chain of routines meets the
    tolerance on the target; if none does, until several features of its part do
    together. `current` is the magnification that the microscope is at. Before leaving
    the one preferred, what the insertion after the look bears is tried there: another
    zoom would cost it a parcentric jump. With `once` only the first magnification and
    the target are tried. `known` is what a contest over the look has shown already.
    """
    settings = views(task, request, current, report)
    if not settings:
        return None
    settings = settings[:1] if once else settings
    job = LookProblem.of(task, request, effects, known or Begun())
    refused: list[_Refused] = []
    look = _by_target(job, settings, refused)
    if look is None and not once:
        look = _by_several(job, settings, refused)
    if look is None:
        _report_failure(request, refused[-1], report)
    return look


def look_at_first(
    task: Task, request: Request, effects: CompileContext, view: ViewPlan, known: Begun
) -> None:
    """Hold the first contest over a look; `known` takes what it shows.

    And races of the part's other features, should the first contest want them.
    """
    job = LookProblem.of(task, request, effects, known)
    alone = job.contest(view)
    fit = is_fit(alone.tried.case, alone.visible)
    if fit and wanted(alone.tried, effects.effort):
        Races(job=job, alone=alone).begin()


def _by_target(
    job: LookProblem, settings: Sequence[ViewPlan], refused: list[_Refused]
) -> CompiledLook | None:
    """Return the look at the first magnification where the target alone does."""
    for view in settings:
        alone = job.contest(view)
        tried = alone.tried
        if tried.selection.chosen is not None:
            return _finish(job, alone, _zooms(refused))
        refused.append(_refusal(view, alone, tried.selection.advice))
        if view is settings[0] and (look := _kept(job, view)) is not None:
            return look
        if job.is_round:
            break  # no magnification gives it the angle that is needed
    return None


def _refusal(view: ViewPlan, alone: TargetResult, advice: str) -> _Refused:
    """Return a magnification that was refused, with what would mend it."""
    tried = alone.tried
    fit = is_fit(tried.case, alone.visible)
    return _Refused(view=view, tried=tried, advice=advice, fit=fit)


def _by_several(
    job: LookProblem, settings: Sequence[ViewPlan], refused: list[_Refused]
) -> CompiledLook | None:
    """Return the look at the first magnification where more of the part does."""
    wider = [(view, wide) for view in settings for wide in _wider(job, view)]
    for view, whole in wider:
        alone = job.contest(whole)
        if alone.tried.selection.chosen is not None:
            return _finish(job, alone, _zooms(refused))
        sets = FeatureSetSearch(job=job, alone=alone).run()
        if sets.chosen is not None:
            return _finish_set(job, alone.tried, sets, _zooms(refused))
        refused.append(_refusal(view, alone, sets.advice))
    return None


def _wider(job: LookProblem, view: ViewPlan) -> list[ViewPlan]:
    """Return views that show more of the target's part, the smaller first."""
    found = [whole_view(job.task, job.request, view)]
    if job.is_round:  # the task's own marks tell the angle, if any do
        found.insert(0, marks_view(job.task, job.request, view))
    return [v for k, v in enumerate(found) if v not in (view, *found[:k])]


def _kept(job: LookProblem, view: ViewPlan) -> CompiledLook | None:
    """Return a look that fails its share, where another zoom would cost more.

    The insertion after it bears it, or would be less likely with a faultless look at
    another zoom.
    """
    asked_um, bears = job.request.tolerance_um, job.request
    if asked_um is None:
        return None
    if bears.admissible_um is not None and bears.admissible_um > asked_um:
        look = _at(job.asked(bears.admissible_um, BORNE), view)
        if look is not None:
            return look
    if bears.break_even_um is None or bears.break_even_um <= asked_um:
        return None
    alone = job.asked(bears.break_even_um, WORTH).contest(view, to_the_end=True)
    # not the cheapest that is worth it, but the best
    reliable = alone.tried.selection.pareto
    best_um = NEAR * min((s.need_um for s in reliable), default=math.inf)
    return _at(job.asked(min(best_um, bears.break_even_um), WORTH), view)


def _at(job: LookProblem, view: ViewPlan) -> CompiledLook | None:
    """Return the look at a magnification, None if no chain is good enough."""
    alone = job.contest(view)
    return None if alone.tried.selection.chosen is None else _finish(job, alone, ())


def _finish(
    job: LookProblem, alone: TargetResult, refused: tuple[ZoomTried, ...]
) -> CompiledLook:
    """Return a look whose target alone does, or several features where those are
    wanted and do better, or have one to spare."""
    search, tried = FeatureSetSearch(job=job, alone=alone), alone.tried
    if wanted(tried, job.effects.effort):
        sets = search.run()
        if sets.chosen is not None:
            return _finish_set(job, tried, sets, refused)
        rows = sets.rows
    else:
        rows = search.left_out()
    found = (measured(job, tried),)
    decided = LookDecision(
        tried=tried, found=found, rows=rows, together=None, refused=refused
    )
    return compiled(job, decided)


def _finish_set(
    job: LookProblem,
    tried: Evaluation,
    sets: FeatureSetResult,
    refused: tuple[ZoomTried, ...],
) -> CompiledLook:
    """Return a look that measures the features of a set."""
    chosen = sets.chosen
    if chosen is None:
        raise ValueError("no set was chosen")
    found = tuple(
        measured(job, raced.tried, raced.shape, sight.sigma_um)
        for raced, sight in zip(chosen.raced, chosen.sights, strict=True)
    )
    decided = LookDecision(
        tried=tried, found=found, rows=sets.rows, together=chosen, refused=refused
    )
    return compiled(job, decided)


def _zooms(refused: Sequence[_Refused]) -> tuple[ZoomTried, ...]:
    """Return what the plan says of the magnifications refused so far."""
    return tuple(
        ZoomTried(magnification=r.view.microscope.magnification, reason=r.advice)
        for r in refused
    )


def _report_failure(request: Request, last: _Refused, report: Report) -> None:
    """Report that neither a chain nor a set of features is good enough."""
    reasons = rejections(last.tried.selection.reasons)
    report.refuse(
        "MP501",
        request.where,
        f"look {request.id!r}: no routine finds {request.target} well enough at "
        f"{last.view.microscope.magnification:.4g} x, 2 sigma + |bias| within "
        f"{last.tried.case.tolerance_um:.3g} um ({request.asked_by}): {reasons}",
        commonest_hint(last.tried.scores, last.advice) if last.fit else last.advice,
    )
