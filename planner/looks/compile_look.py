"""Compilation of one look: its magnification, its target alone or a feature set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from microplan.featuresel.selection.evaluate import is_fit
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import WRONG_TOLERANCES
from microplan.planner.looks.cost_findings import report_costs
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.feature_evaluation import (
    begin_features,
    evaluate_features,
    without_chains,
)
from microplan.planner.looks.feature_sets import (
    FeatureSetResult,
    FeatureSetSearch,
    wanted,
)
from microplan.planner.looks.look_problem import Begun, CompileContext, LookProblem
from microplan.planner.looks.look_record import (
    CompiledLook,
    LookDecision,
    compiled,
    measured,
)
from microplan.planner.looks.measures import MeasuredFeature
from microplan.planner.looks.model_errors.effect_rows import effect_rows
from microplan.planner.looks.records import commonest_hint, rejections
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import marks_view, views, whole_view
from microplan.planner.views.views import ViewPlan
from microplan.schemas import plan as p
from microplan.schemas.plan.views import ZoomTried

ADMISSIBLE = "what the insertion bears at this magnification"
BREAK_EVEN = "the best here: another zoom would cost the insertion more"
NEAR = 1.05  # of the best need, so that new draws of the same chain keep it


# An evaluation in which nothing was good enough, and advice
_Refused = tuple[Evaluation, str]


def compile_look(
    task: Task,
    request: Request,
    context: CompileContext,
    current: float,
    report: Report,
    *,
    once: bool = False,
    known: Begun | None = None,
) -> CompiledLook | None:
    """Return the compiled look of a request, None if it cannot be done: see `report`.

    Magnifications are tried in order of preference until a chain of routines meets the
    tolerance on the target; if none does, until several features of its part do
    together. `current` is the magnification that the microscope is at. Before leaving
    the one preferred, the error that the following insertion tolerates is tried there:
    another zoom would cost it a parcentric jump. With `once` only the first
    magnification and the target are tried. `known` has results of the look already.
    """
    settings = views(task, request, current, report)
    if not settings:
        return None
    settings = settings[:1] if once else settings
    problem = LookProblem(
        task=task, request=request, context=context, begun=known or Begun()
    )
    refused: list[_Refused] = []
    look = _by_target(problem, settings, refused)
    if look is None and not once:
        look = _by_several(problem, settings, refused)
    if look is None:
        _report_failure(request, refused[-1], report)
        return None
    return look if report_costs(request, look.look, look.found, report) else None


def look_at_first(
    task: Task, request: Request, context: CompileContext, view: ViewPlan, known: Begun
) -> None:
    """Evaluate a look at its first magnification; `known` takes the results.

    The part's other features are evaluated, too, where the first result wants them.
    """
    problem = LookProblem(task=task, request=request, context=context, begun=known)
    tried = problem.evaluate(view)
    if _is_fit(tried) and wanted(tried, context.effort):
        begin_features(problem, tried)


def _is_fit(tried: Evaluation) -> bool:
    """Return whether the target is visible, and has the angle that is needed."""
    return is_fit(tried.case, tried.comparison.visible)


def _by_target(
    problem: LookProblem, settings: Sequence[ViewPlan], refused: list[_Refused]
) -> CompiledLook | None:
    """Return the look at the first magnification where the target alone does."""
    for view in settings:
        tried = problem.evaluate(view)
        if tried.comparison.selection.chosen is not None:
            return _finish(problem, tried, refused)
        refused.append((tried, tried.comparison.selection.advice))
        if view is settings[0] and (look := _kept(problem, view)) is not None:
            return look
        if problem.is_round:
            break  # no magnification gives it the angle that is needed
    return None


def _by_several(
    problem: LookProblem, settings: Sequence[ViewPlan], refused: list[_Refused]
) -> CompiledLook | None:
    """Return the look at the first magnification where more of the part does."""
    for wide in [wide for view in settings for wide in _wider(problem, view)]:
        tried = problem.evaluate(wide)
        if tried.comparison.selection.chosen is not None:
            return _finish(problem, tried, refused)
        effects = _effects(problem, tried)
        sets, found = _together(problem, tried, effects)
        if sets.chosen is not None:
            return _decide(problem, tried, effects, sets, found, refused)
        refused.append((tried, sets.advice))
    return None


def _wider(problem: LookProblem, view: ViewPlan) -> list[ViewPlan]:
    """Return views that show more of the target's part, the smaller first."""
    found = [whole_view(problem.task, problem.request, view)]
    if problem.is_round:  # the task's own marks have the angle, if any do
        found.insert(0, marks_view(problem.task, problem.request, view))
    return [v for k, v in enumerate(found) if v not in (view, *found[:k])]


def _kept(problem: LookProblem, view: ViewPlan) -> CompiledLook | None:
    """Return a look that fails its share, where another zoom would cost more.

    The insertion after it tolerates it, or would be less likely with a faultless look
    at another zoom.
    """
    asked_um, request = problem.request.tolerance_um, problem.request
    if asked_um is None:
        return None
    if request.admissible_um is not None and request.admissible_um > asked_um:
        look = _at(problem.asked(request.admissible_um, ADMISSIBLE), view)
        if look is not None:
            return look
    if request.break_even_um is None or request.break_even_um <= asked_um:
        return None
    even = problem.asked(request.break_even_um, BREAK_EVEN)
    # not the cheapest that is worth it, but the best
    reliable = even.evaluate(view, to_the_end=True).comparison.selection.pareto
    best_um = NEAR * min(map(_attainable_um, reliable), default=math.inf)
    return _at(problem.asked(min(best_um, request.break_even_um), BREAK_EVEN), view)


def _attainable_um(score: ChainScore) -> float:
    """Return the least tolerance that a chain meets, um: its corners pass, too."""
    return max(score.need_um, (score.worst_um or 0.0) / WRONG_TOLERANCES)


def _at(problem: LookProblem, view: ViewPlan) -> CompiledLook | None:
    """Return the look at a magnification, None if no chain is good enough."""
    tried = problem.evaluate(view)
    if tried.comparison.selection.chosen is None:
        return None
    return _finish(problem, tried, ())


def _finish(
    problem: LookProblem, tried: Evaluation, refused: Sequence[_Refused]
) -> CompiledLook:
    """Return a look at its target alone, or at a set where that has more margin."""
    effects = _effects(problem, tried)
    if wanted(tried, problem.context.effort):
        sets, found = _together(problem, tried, effects)
    else:
        search = FeatureSetSearch(problem=problem, tried=tried)
        sets = FeatureSetResult(chosen=None, rows=search.left_out(), advice="")
    if sets.chosen is None:
        found = (measured(problem, tried, effects=effects),)
    return _decide(problem, tried, effects, sets, found, refused)


def _effects(problem: LookProblem, tried: Evaluation) -> tuple[p.EffectRow, ...]:
    """Return the effects ledger of a look."""
    return effect_rows(problem.task, problem.request, tried, problem.context.memo)


def _together(
    problem: LookProblem, tried: Evaluation, effects: Sequence[p.EffectRow]
) -> tuple[FeatureSetResult, tuple[MeasuredFeature, ...]]:
    """Return the set to use, and its features; none if there is no set.

    A feature's chain to which errors of images cannot be charged is struck out, and the
    set is chosen again.
    """
    search = FeatureSetSearch(problem=problem, tried=tried)
    tested, skipped = evaluate_features(problem, tried)
    struck: dict[str, Mapping[Chain, str]] = {}
    while True:
        left = [
            without_chains(each, struck.get(each.shape.name, {})) for each in tested
        ]
        sets = search.among(left, skipped)
        if sets.chosen is None:
            return sets, ()
        both = zip(sets.chosen.tested, sets.chosen.sights, strict=True)
        found = tuple(
            measured(problem, each.tried, each.shape, sight.sigma_um, effects)
            for each, sight in both
        )
        faults = {m.shape.name: m for m in found if m.charges.fault}
        if not faults:
            usable_um = [each.usable.focus_um for each in found]
            chosen = search.repeated(sets.chosen, usable_um)
            return replace(sets, chosen=chosen), found
        for name, each in faults.items():
            why = {each.chosen.chain: f"errors of images: {each.charges.fault}"}
            struck[name] = {**struck.get(name, {}), **why}


def _decide(
    problem: LookProblem,
    tried: Evaluation,
    effects: tuple[p.EffectRow, ...],
    sets: FeatureSetResult,
    found: tuple[MeasuredFeature, ...],
    refused: Sequence[_Refused],
) -> CompiledLook:
    """Return a look that measures the features of a set, or the target alone."""
    zooms = tuple(
        ZoomTried(magnification=each.case.microscope.magnification, reason=advice)
        for each, advice in refused
    )
    decided = LookDecision(
        tried=tried, found=found, rows=sets.rows, effects=effects,
        together=sets.chosen, refused=zooms,
    )  # fmt: skip
    return compiled(problem, decided)


def _report_failure(request: Request, refused: _Refused, report: Report) -> None:
    """Report that neither a chain nor a set of features is good enough."""
    tried, advice = refused
    if _is_fit(tried):
        advice = commonest_hint(tried.comparison.scores, advice)
    reasons = rejections(tried.comparison.selection.reasons)
    report.refuse(
        "MP501",
        request.where,
        f"look {request.id!r}: no routine finds {request.target} well enough at "
        f"{tried.case.microscope.magnification:.4g} x, 2 sigma + |bias| within "
        f"{tried.case.tolerance_um:.3g} um ({request.asked_by}): {reasons}",
        advice,
    )
