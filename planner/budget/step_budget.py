"""Error budget of one step, with its verdicts on fit, grasp, release."""

from __future__ import annotations

import math

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.mating import fit_verdict, mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import residual_after, unaligned
from microplan.planner.budget.allowable_errors import with_allowable_errors
from microplan.planner.budget.budget import (
    EMPTY_BUDGET,
    grasp_budget,
    release_budget,
    verify_budget,
)
from microplan.planner.budget.insert_budget import (
    insert_budget,
    insertion_of,
    share_of_goal,
)
from microplan.planner.budget.insertion import LateralResidual
from microplan.planner.budget.measurement_history import (
    MeasurementHistory,
    method_taken,
)
from microplan.planner.budget.placing import placing_words
from microplan.planner.budget.probability.collision_probability import with_collisions
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.mechanics.gripping import grasp_verdict
from microplan.planner.mechanics.releasing import release_verdict
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import insertion_after
from microplan.schemas import plan as p
from microplan.schemas.plan.verdicts import (
    FitVerdict,
    GraspVerdict,
    PlacingVerdict,
    ReleaseVerdict,
)


def verdicts_of(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> tuple[FitVerdict | None, GraspVerdict | None, ReleaseVerdict | None]:
    """Return the verdicts on the fit, the grasp and the release of a step."""
    fit = grasp = release = None
    if here.step.verb == "insert":
        mating = mating_of(task, here.step, here.after)
        tilt_rad = task.workcell.stage.axis_tilt_sigma_rad
        fit = None if mating is None else fit_verdict(mating, tilt_rad)
    if here.step.verb == "grasp":
        grasp = grasp_verdict(task, here)
    if here.step.verb == "release":
        release = release_verdict(task, states, here)
    return fit, grasp, release


def report_handling(
    here: StepState,
    grasp: GraspVerdict | None,
    release: ReleaseVerdict | None,
    report: Report,
    placing: PlacingVerdict | None = None,
) -> None:
    """Report the verdicts on grasp, release, placement, with their numbers."""
    step = here.step
    if placing is not None:
        report.fact("MP615", step.where, placing_words(step.id, placing))
    if grasp is not None:
        words = f"step {step.id!r}: {grasp.verdict}: {grasp.reason}; {_stands(grasp)}"
        if grasp.verdict == "will slip":
            report.warning("MP614", step.where, words, "close the jaws further")
        elif grasp.room_um < grasp.needed_um:
            hint = "open the jaws further before, or align more finely"
            report.warning("MP614", step.where, words, hint)
        elif grasp.verdict == "holds":
            report.fact("MP614", step.where, words)
        else:
            hint = "not in P(success); jaws closed further hold it better"
            report.note("MP614", step.where, words, hint)
    if release is None:
        return
    words = f"step {step.id!r}: {release.verdict}: {release.reason}"
    if release.verdict == "will stick":
        report.refuse("MP613", step.where, words, "lower humidity, ground, roughen")
    elif release.verified_by is None:
        hint = "add a step 'do: verify' after it"
        report.note("MP613", step.where, words + "; no later step looks", hint)
    else:
        report.fact("MP613", step.where, f"{words}; {release.verified_by!r} looks")


def _stands(grasp: GraspVerdict) -> str:
    """Return the description of a part between the jaws."""
    narrow, wide = grasp.width_range_um
    words = (
        f"{grasp.room_um:.3g} um beside it, {grasp.needed_um:.3g} um needed at 3 sigma;"
        f" {narrow:.4g}..{wide:.4g} um wide over all angles"
    )
    if grasp.theta_within_rad is None:
        return f"{words}, which no jaw turns"
    within = f"angle within {grasp.theta_within_rad * 1e3:.3g} mrad"
    if grasp.theta_sigma_rad >= math.pi:
        return f"{words}, {within} of one of {grasp.settles}"
    return f"{words}, {within}, sigma {grasp.theta_sigma_rad * 1e3:.3g} mrad once held"


def budget_of(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    history: MeasurementHistory,
    context: CompileContext,
) -> p.Budget:
    """Return the error budget of the step's mechanical action and of its moves."""
    step, budget = here.step, EMPTY_BUDGET
    if step.verb == "grasp":
        budget = grasp_budget(task, here.at_look, step)
    if step.verb == "release":
        budget = release_budget(task, here.before.tool or "")
    if step.verb == "verify":
        seen = [history.seen.get(owner_of(n or "")) for n in (step.target, step.on)]
        budget = verify_budget(task.workcell, step, seen[0], seen[1])
    if step.verb == "insert":
        budget = _of_insertion(task, states, here, history, context)
    return with_collisions(task, here, budget)


def _of_insertion(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    history: MeasurementHistory,
    context: CompileContext,
) -> p.Budget:
    """Return the budget of an insertion, with the allowable errors of its looks."""
    left, goal = left_of(task, states, insert, history), share_of_goal(task)
    job = insertion_of(task, states, insert, left, history.seen)
    if job is None:
        return EMPTY_BUDGET
    choice = history.choice
    methods = [
        (option.method, option.success_probability)
        for option in (choice.options if choice else ())
        if choice
        and option.method != choice.method
        and option.success_probability is not None
    ]
    budget = context.memo.call(insert_budget, job, left, goal=goal, methods=methods)
    mates = [owner_of(n or "") for n in (insert.step.target, insert.step.onto)]
    return with_allowable_errors(budget, task, job, goal, history, mates, context)


def left_of(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    history: MeasurementHistory,
) -> LateralResidual:
    """Return the lateral residual of the alignment before an insertion.

    Without one nothing is cut off: the parts' position errors are left.
    """
    aligns = [s for s in states if s.step.verb == "align"]
    align = next((s for s in aligns if insertion_after(states, s) is insert.step), None)
    if align is None:
        parts = [owner_of(n or "") for n in (insert.step.target, insert.step.onto)]
        since = "since something last moved sideways"
        return unaligned(insert.before, parts, since)
    method = method_taken(align, history)
    return residual_after(task, align, method, history.within_um, history.before)
