"""The compiler: a pipeline from a task to the content of a plan folder."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.world import (
    axis_move,
    build_world,
    finger_solids,
    part_solids,
)
from microplan.planner.budget.insert_budget import share_of_goal
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.looks.picture_errors import report_trueness
from microplan.planner.looks.progress.work import Work
from microplan.planner.plan.confidence import bound_of, more_trials, report_unshown
from microplan.planner.plan.emit import PlanFiles
from microplan.planner.plan.fit_picture import fit_pictures
from microplan.planner.plan.open_queue import CLUSTER, turns_of
from microplan.planner.plan.options import Options as Options
from microplan.planner.plan.requirements import requirements
from microplan.planner.plan.sketch import sketch_looks
from microplan.planner.plan.speculation import Ahead, begin, plan_work
from microplan.planner.plan.steps import CompiledStep, compile_step
from microplan.planner.plan.task_records import (
    beliefs_of,
    feature_places,
    inputs_of,
    provenance_of,
)
from microplan.planner.queue.turns import Turns
from microplan.planner.queue.workers import until_told
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.store.memo import EVERY_TIME
from microplan.planner.task.presets import PRESETS, Effort, Preset, Sketch
from microplan.planner.task.second_reader import read_twice
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import check_tolerances
from microplan.planner.views.check_task import check_fits
from microplan.planner.views.fit_angles import unfold_with_angles
from microplan.schemas import plan as p
from microplan.schemas.files.evidence import Scenes

UNLIKELY = "MP602"  # every step can be done, together they succeed too rarely
_WANTED_NOW = 1.0  # priority of the next step's chunks: before looks begun ahead


def compile_task(task: Task, report: Report, options: Options) -> PlanFiles | None:
    """Return everything a plan folder holds, None if the task contradicts itself.

    A task that is understood but cannot be done gives a plan whose status is
    `infeasible`, with the reasons and the steps up to the first that failed; none where
    axes cannot meet a tolerance, which is known before anything is rendered.
    """
    started = time.perf_counter()
    read_twice(task, report, options.memo)
    task, states = unfold_with_angles(task, report)
    check_fits(task, states, report)
    can_align = check_tolerances(task, states, report)
    if report.failed:
        return None
    if options.preset == p.SKETCH:
        return _sketch(task, states, options, report, started)
    preset = options.preset or task.optimise.prefer
    effort, before = options.effort or PRESETS[preset], tuple(report.found)
    todo = states if can_align else ()
    compiled = partial(_compiled, task, states, todo, preset, options, report)
    plan, steps, timings = compiled(effort)
    more = more_trials(plan, effort, options.confidence)
    while more is not None:
        effort, report.found[:] = more, before
        plan, steps, timings = compiled(effort)
        more = more_trials(plan, effort, options.confidence)
    looks = [look for step in steps for look in step.looks]
    return PlanFiles(
        plan=plan,
        world=build_world(task, initial(task)),
        scenes=Scenes(looks=tuple(look.placed for look in looks)),
        images={
            **{look.look.scene.image: look.picture for look in looks},
            **fit_pictures(task, states),
        },
        figures=tuple(look.figures for look in looks if look.figures is not None),
        arrays={k: v for look in looks for k, v in look.arrays.items()},
        timings={**timings, "total_s": time.perf_counter() - started},
        inputs=inputs_of(report),
    )


def _sketch(
    task: Task,
    states: tuple[StepState, ...],
    options: Options,
    report: Report,
    started_s: float,
) -> PlanFiles:
    """Return a plan of what looks show, in which nothing was tried.

    Everything that needs no trials has been checked, and counts against it.
    """
    limit = options.max_image_error or task.optimise.image_error(task.optimise.prefer)
    found = sketch_looks(task, states, report, options.memo)
    plan = build_plan(task, states, (), report, preset=p.SKETCH, limit=limit)
    if not plan.reasons:
        plan = replace(plan, status=p.SKETCH)
    return PlanFiles(
        plan=replace(plan, sketched=tuple(each.look for each in found)),
        world=build_world(task, initial(task)),
        scenes=Scenes(looks=tuple(each.placed for each in found)),
        images={
            **{each.look.scene.image: each.picture for each in found},
            **fit_pictures(task, states),
        },
        arrays={},
        timings={"total_s": time.perf_counter() - started_s},
        inputs=inputs_of(report),
    )


def _compiled(
    task: Task,
    states: tuple[StepState, ...],
    todo: tuple[StepState, ...],
    preset: Preset,
    options: Options,
    report: Report,
    effort: Effort,
) -> tuple[p.Plan, list[CompiledStep], dict[str, float]]:
    """Return the plan that an effort gives, the steps to be done, and their times."""
    limit = options.max_image_error or task.optimise.image_error(preset)
    work = Work(heard=options.progress)
    with turns_of(options.jobs, options.scheduler, report) as turns:
        mixed = CLUSTER in {finding.code for finding in report.found}
        context = CompileContext(
            effort=effort,
            max_image_error=limit,
            map=until_told,
            memo=EVERY_TIME if mixed else options.memo,
        )
        steps, timings = _steps(task, todo, context, report, work, turns)
    plan = build_plan(
        task,
        states,
        steps,
        report,
        preset=preset,
        limit=limit,
        confidence=options.confidence,
    )
    return plan, steps, timings


def build_plan(
    task: Task,
    states: Sequence[StepState],
    steps: Sequence[CompiledStep],
    report: Report,
    *,
    preset: Preset | Sketch,
    limit: float,
    confidence: float | None = None,
) -> p.Plan:
    """Return the plan of the steps that could be compiled."""
    start = initial(task)
    compiled = tuple(step.step for step in steps)
    success = math.prod((s.budget.success_probability for s in compiled), start=1.0)
    complete = len(compiled) == len(states)
    bound = bound_of(task, tuple(states), steps, confidence) if complete else None
    _report_goal(task, compiled, success if complete else None, report)
    looks = [look for step in compiled for look in step.looks]
    report_trueness(task.workcell, task.where["workcell"], looks, report)
    if bound is not None and confidence is not None:
        report_unshown(task, success, bound, report)
    reasons = _reasons(task, report)
    return p.Plan(
        format_version=p.FORMAT_VERSION,
        name=task.name,
        status="infeasible" if reasons else "feasible",
        reasons=reasons,
        provenance=provenance_of(task, preset, limit),
        requirements=requirements(task, states, compiled),
        beliefs=beliefs_of(task, start),
        features=feature_places(task),
        stage_start=axis_move("stage", start.stage),
        robot_start=axis_move("robot", start.robot) if start.tool else None,
        opening_start_um=start.opening_um if start.tool else None,
        success_probability=success if complete else 0.0,
        success_goal=task.success_goal,
        steps=compiled,
        parts=part_solids(task),
        fingers=finger_solids(task),
        success_bound=bound,
    )


def _steps(
    task: Task,
    states: tuple[StepState, ...],
    context: CompileContext,
    report: Report,
    work: Work,
    turns: Turns | None,
) -> tuple[list[CompiledStep], dict[str, float]]:
    """Return the steps up to the first that cannot be done, and their times.

    `work` hears how far they have come. Looks that share `turns` are compiled at a
    time; a step's time is what it takes wherever.
    """
    low, _ = task.workcell.optics.magnification
    if turns is None:
        plan_work(work, task, states, context, low)
        ahead = Ahead(work=work)
    else:
        ahead = begin(turns, task, states, context, low, work)
        context = replace(context, map=turns.map(_WANTED_NOW, ahead.elsewhere))
    history = MeasurementHistory(magnification=low, seen={}, within_um=0.0, key="")
    found: list[CompiledStep] = []
    timings: dict[str, float] = {}
    for index, here in enumerate(states):
        started, before_s = time.perf_counter(), ahead.elsewhere.seconds
        work.step(index, len(states), here.step.id)
        step = compile_step(task, states, index, history, context, report, ahead)
        took_s = time.perf_counter() - started + ahead.elsewhere.seconds - before_s
        timings[f"steps.{here.step.id}_s"] = took_s
        if step is None:
            break
        found.append(step)
        history = step.history
    return found, timings


def _report_goal(
    task: Task, steps: Sequence[p.Step], chance: float | None, report: Report
) -> None:
    """Report a plan whose success probability is below the goal."""
    goal = task.success_goal
    if goal is None or chance is None or chance >= goal:
        return
    needed = share_of_goal(task)
    ranked = sorted(steps, key=lambda step: step.budget.success_probability)
    short = [s for s in ranked if s.budget.success_probability < needed] or ranked[:1]
    costs = ", ".join(
        f"{step.id!r} with {step.budget.success_probability:.4g}" for step in short
    )
    report.refuse(
        UNLIKELY,
        task.where.get("goal.success_probability", task.where["goal"]),
        f"P(success) is {chance:.4g}, the goal {goal:g}, a share of {needed:.4g} for "
        f"every step that may miss; short of it, the worst first: {costs}",
        short[0].budget.advice,
    )


def _reasons(task: Task, report: Report) -> tuple[p.Reason, ...]:
    """Return why the plan is infeasible, empty if it is not: the worst first.

    What cannot be done at all comes before what is only too unlikely.
    """
    found = [d for d in report.in_order if d.severity == "infeasible"]
    found.sort(key=lambda d: d.code == UNLIKELY)  # stable: else by position in the file
    return tuple(
        p.Reason(code=d.code, step=_step_at(task, d.where), message=d.message)
        for d in found
    )


def _step_at(task: Task, where: Span) -> str:
    """Return the step whose declaration a finding points into, "" if none."""
    for step in task.steps:
        places = (step.where, *step.spans.values(), *(m.where for m in step.move))
        if (where.file, where.line) in {(at.file, at.line) for at in places}:
            return step.id
    return ""
