"""The inverse error budget: largest errors of a look that a later step tolerates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from microplan.featuresel.trials.tolerance_search import (
    Direction,
    Setting,
    ToleranceSearch,
    alone,
)
from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import residual_after
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.drift_since_look import DriftTolerance, is_placed
from microplan.planner.budget.insert_budget import insertion_of, share_of_goal
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.budget.offenders import largest_um
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.looks.measures import MeasuredFeature
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.task import Task
from microplan.planner.views.requests import insertion_after
from microplan.schemas.plan import Budget
from microplan.schemas.plan.verdicts import Allowed

OTHER_ZOOM = 2.0  # any that is not the present one: every change has the same jump
HOPELESS = 1e-3  # a probability at another zoom that decides nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class AdmissibleError:
    """Largest error of a look that the next insertion tolerates, 2 sigma + |bias|."""

    admissible_um: float | None = None  # the insertion still has its share of the goal
    # the insertion is as likely as with a faultless look at any other zoom
    break_even_um: float | None = None


def admissible_errors(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    within_um: float,
    seen: Mapping[str, PastMeasurement],
    memo: Memo = EVERY_TIME,
) -> AdmissibleError:
    """Return the largest error of an alignment's look that its insertion tolerates.

    Twice the largest sigma of the look, its setting that of the last look at the same
    part. Nothing if no insertion follows, no goal is specified, or no sigma would do.
    """
    step, goal = insertion_after(states, align), share_of_goal(task)
    owner = owner_of(align.step.target or "")
    before = seen.get(owner)
    if step is None or before is None or goal <= 0 or before.sigma_um <= 0:
        return AdmissibleError()
    here = next(s for s in states if s.step is step)
    look = replace(
        before, step=align.step.id, sigma_without_scale_um=None, trueness_um=0.0
    )  # all of it is asked for at once
    left = residual_after(task, align, "servo", within_um, before)

    def job(look: PastMeasurement) -> Insertion | None:
        return insertion_of(task, states, here, left, {**seen, owner: look})

    far = replace(look, magnification=OTHER_ZOOM * look.magnification)
    stays, leaves = job(look), job(far)
    if stays is None or leaves is None or look.term not in stays.sizes_um:
        return AdmissibleError()
    elsewhere = 1 - leaves.scaled(look.term, 0.0).miss

    def twice(chance: float) -> float | None:
        largest = memo.call(largest_um, stays, look.term, look.sigma_um, chance)
        return None if largest is None else 2 * largest

    return AdmissibleError(
        admissible_um=twice(goal),
        break_even_um=twice(elsewhere) if HOPELESS < elsewhere < goal else None,
    )


# Fewer do not determine their scatter: six degrees of freedom put sigma to 30 %.
LEAST_DRAWS = 4
UNITS = {"focus": "um", "pose": "um"}
ORDER: tuple[Setting, ...] = ("focus", "zoom", "light", "gradient", "pose")
BOTH: tuple[Literal[-1, 1], ...] = (-1, 1)
ONE_SIDED = ("gradient", "pose")
DIRECTIONS = tuple(
    Direction(setting, sign)
    for setting in ORDER
    for sign in (BOTH[1:] if setting in ONE_SIDED else BOTH)
)


def with_allowable_errors(
    budget: Budget,
    task: Task,
    job: Insertion,
    goal: float,
    history: MeasurementHistory,
    parts: Iterable[str],
    context: CompileContext,
) -> Budget:
    """Return a budget with the allowable error of each setting of the parts' looks.

    Parameters
    ----------
    budget : Budget
        Of an insertion or a placement, with its analysis.
    task : Task
        The task.
    job : Insertion
        The insertion or placement, with all its errors.
    goal : float
        Probability that it must keep; where it is below that, nothing is allowed.
    history : MeasurementHistory
        The last looks by part.
    parts : iterable of str
        The parts whose looks serve it.
    context : CompileContext
        How many images may be spent.

    Returns
    -------
    Budget
        With errors one at a time, of a look at several features for each of them by
        itself. Steps are those of `microplan.featuresel.trials.tolerance_search`: the
        next one was not tolerated.
    """
    if budget.analysis is None:
        raise ValueError("the budget of a look's errors has an analysis")
    if goal <= 0 or 1 - job.miss < goal:
        return budget
    allowed = tuple(
        row
        for part in parts
        if part in history.looks
        for row in _of_look(
            task, job, goal, history.seen[part].term, history.looks[part], context
        )
    )
    return replace(budget, analysis=replace(budget.analysis, allowed=allowed))


def _of_look(
    task: Task,
    job: Insertion,
    goal: float,
    term: str,
    look: CompiledLook,
    context: CompileContext,
) -> Iterator[Allowed]:
    """Yield a row for each setting of one look."""
    draws = max(context.effort.drift_draws, LEAST_DRAWS)
    found = [
        _drifts(task, job, goal, term, each, context, draws) for each in look.found
    ]
    for setting in ORDER:
        sides = [[drifts[d] for d in DIRECTIONS if d.setting == setting]
                 for drifts in found]  # fmt: skip
        least, most = min(max(s) for s in sides), max(min(s) for s in sides)
        ratio = 1.0 if setting in ("zoom", "light") else 0.0
        yield Allowed(
            error=setting,
            look=look.look.target,
            least=0.0 if setting in ONE_SIDED else ratio + most,
            most=ratio + least,
            unit=UNITS.get(setting, "1"),
            source=f"{draws} draws a step, all else as it is",
        )


def _drifts(
    task: Task,
    job: Insertion,
    goal: float,
    term: str,
    found: MeasuredFeature,
    context: CompileContext,
    draws: int,
) -> dict[Direction, float]:
    """Return the last drift tolerated in every direction by one feature of a look."""
    search = ToleranceSearch(
        case=found.tried.case,
        prepared=alone(found.tried.comparison.prepared, found.chosen.chain),
        root_seed=task.seed,
        draws=draws,
    )
    tolerance = partial(
        DriftTolerance,
        job=job,
        goal=goal,
        term=term,
        bias_um=found.promised.bias_um or (0.0, 0.0),
        lateral_um=task.workcell.optics.focus.lateral_sigma_um_per_um,
    )
    asked = [(d, tolerance(setting=d.setting)) for d in DIRECTIONS]
    reached = context.memo.each(_reach, search, asked, context.map)
    return dict(zip(DIRECTIONS, reached, strict=True))


def _reach(search: ToleranceSearch, asked: tuple[Direction, DriftTolerance]) -> float:
    direction, tolerance = asked
    return search.reach(direction, is_placed, tolerance)
