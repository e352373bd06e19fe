"""Compilation of one step: looks, action, control, conditions, budget."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

from microplan.planner.assembly.assembly import axes_of, locate_place, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.world import axis_move
from microplan.planner.budget.allowable_errors import admissible_errors
from microplan.planner.budget.control import control_of, tolerance_um
from microplan.planner.budget.measurement_history import MeasurementHistory, remember
from microplan.planner.budget.methods import method_of
from microplan.planner.budget.placement_budget import place_budget
from microplan.planner.budget.step_budget import budget_of, report_handling, verdicts_of
from microplan.planner.looks.coarse_to_fine import waits_between
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.mechanics.mechanics import mechanical_rows
from microplan.planner.plan.actions import action_of
from microplan.planner.plan.requirements import conditions_of
from microplan.planner.plan.speculation import Ahead
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.view_times import (
    MicroscopeSetting,
    approach_times,
    setting_time_s,
    view_change,
)
from microplan.schemas import plan as p
from microplan.schemas.codec import to_data
from microplan.schemas.plan.views import TimeRow

IRREVERSIBLE = ("grasp", "insert", "release")
PHYSICAL = (*IRREVERSIBLE, "move", "align")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledStep:
    """A step of the plan, its looks with their files, the history after it."""

    step: p.Step
    looks: tuple[CompiledLook, ...]
    history: MeasurementHistory


def compile_step(
    task: Task,
    states: tuple[StepState, ...],
    index: int,
    history: MeasurementHistory,
    context: CompileContext,
    report: Report,
    ahead: Ahead | None = None,
) -> CompiledStep | None:
    """Return step `index`, None if one of its looks cannot be done.

    `ahead` has looks that were begun before.
    """
    ahead = ahead or Ahead()
    here = states[index]
    goal = history.seen.get(owner_of(here.step.to or ""))
    within: float | None = None
    if here.step.verb == "align":
        within = tolerance_um(task, states, here, goal)
    looks: list[CompiledLook] = []
    before = history.seen.get(owner_of(here.step.target or ""))
    asked = requests(task, states, index, within)
    if within is not None:
        allowed = admissible_errors(
            task, states, here, within, history.seen, context.memo
        )
        asked = tuple(replace(request, **asdict(allowed)) for request in asked)
    for request in asked:
        found = ahead.looks(task, request, context, history.magnification, report)
        if not found:
            return None
        for look in found:
            waits = _waits(task, here, request, look, first=not looks)
            looks.append(_timed(task, look, history, waits))
            history = remember(
                history, here.step.id, looks[-1], _moved_um(task, here, look)
            )
    if within is not None:
        choice = method_of(task, states, here, within, history.seen, report, before)
        history = replace(history, within_um=within, choice=choice, before=before)
    step = _step(task, states, here, tuple(looks), history, context)
    history = _after_sweep(history, step)
    report_handling(here, step.grasp, step.release, report, step.placing)
    step = replace(step, key=journal_key(step, history.key))
    return CompiledStep(
        step=step, looks=tuple(looks), history=replace(history, key=step.key)
    )


def _waits(
    task: Task, here: StepState, request: Request, look: CompiledLook, *, first: bool
) -> tuple[TimeRow, ...]:
    """Return what moves before a look: for the step, or to centre what was found."""
    if first:
        return approach_times(task, here)
    return () if look.look.coarse is None else waits_between(task, request)


def _timed(
    task: Task,
    look: CompiledLook,
    history: MeasurementHistory,
    waits: Sequence[TimeRow],
) -> CompiledLook:
    """Return a look with what it takes after the look before."""
    if look.look.verdict is None:
        raise ValueError(f"look {look.look.id} has no verdict")
    change = view_change(task, look.look, history.setting, waits)
    verdict = replace(look.look.verdict, change=change)
    return replace(look, look=replace(look.look, verdict=verdict))


def _moved_um(task: Task, here: StepState, look: CompiledLook) -> float:
    """Return the position error of a target by the moves there and back, um."""
    if look.look.coarse is None:
        return 0.0
    carrier = locate_place(task, here.at_look, here.step.target or "").carrier
    return math.sqrt(2) * axes_of(task, carrier).repeatability_xy_um


def _after_sweep(history: MeasurementHistory, step: p.Step) -> MeasurementHistory:
    """Return the history after an action: a height sweep ends at its last focus."""
    action = step.action
    if not isinstance(action, p.VerifyAction) or action.height is None:
        return history
    height = action.height
    view = next(look.view for look in step.looks if look.id == height.look)
    view = replace(view, focus_um=height.focus_um[-1])
    setting = MicroscopeSetting(look=height.look, view=view)
    return replace(history, setting=setting, magnification=view.magnification)


def journal_key(step: p.Step, before: str) -> str:
    """Return the sha256 of a step's content and the key of the step before it."""
    content = json.dumps(to_data(replace(step, key="")), sort_keys=True)
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


def _step(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    looks: Sequence[CompiledLook],
    history: MeasurementHistory,
    context: CompileContext,
) -> p.Step:
    """Return the plan's step, without its key."""
    step = here.step
    control = None
    if step.verb == "align" and history.choice is not None:
        setting_s = setting_time_s(task, here, looks[0].look)
        control = control_of(
            task, here, history.within_um, history.choice, setting_s=setting_s
        )
    budget, placing = budget_of(task, states, here, history, context), None
    if step.verb == "release":
        placed = place_budget(task, states, here, history, context)
        budget, placing = placed or (budget, None)
    fit, grasp, release = verdicts_of(task, states, here)
    return p.Step(
        id=step.id,
        verb=step.verb,
        key="",
        physical=step.verb in PHYSICAL or bool(here.moves),
        irreversible=step.verb in IRREVERSIBLE,
        moves=tuple(axis_move(move.axes, move.to) for move in here.moves),
        looks=tuple(look.look for look in looks),
        action=action_of(task, here, looks, context.memo),
        control=control,
        conditions=conditions_of(here),
        budget=budget,
        fit=fit,
        grasp=grasp,
        release=release,
        placing=placing,
        effects=mechanical_rows(here, budget, fit, grasp, release),
    )
