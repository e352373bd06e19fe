"""The error budget of one step, from what earlier looks and alignments leave."""

from __future__ import annotations

from dataclasses import replace

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import residual_after, unaligned
from microplan.planner.budget.allowable_errors import allowable_errors
from microplan.planner.budget.budget import (
    empty_budget,
    grasp_budget,
    release_budget,
    verify_budget,
)
from microplan.planner.budget.insert_budget import (
    LateralResidual,
    insert_budget,
    share_of_goal,
)
from microplan.planner.budget.insertion_problem import insertion_of
from microplan.planner.budget.measurement_history import (
    MeasurementHistory,
    method_taken,
)
from microplan.planner.budget.probability.collision_probability import passed
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.task.task import Task
from microplan.planner.views.requests import insertion_after
from microplan.schemas import plan as p


def budget_of(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    memory: MeasurementHistory,
    effects: CompileContext,
) -> p.Budget:
    """Return the error budget of the step's mechanical action and of its moves."""
    return passed(task, here, _of_action(task, states, here, memory, effects))


def _of_action(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    memory: MeasurementHistory,
    effects: CompileContext,
) -> p.Budget:
    """Return the error budget of the step's mechanical action alone."""
    step = here.step
    if step.verb == "grasp":
        return grasp_budget(task, here.at_look, step)
    if step.verb == "release":
        return release_budget(task, here.before.tool or "")
    if step.verb == "verify":
        seen = [memory.seen.get(owner_of(n or "")) for n in (step.target, step.on)]
        return verify_budget(task.workcell, step, seen[0], seen[1])
    if step.verb != "insert":
        return empty_budget()
    return _of_insertion(task, states, here, memory, effects)


def _of_insertion(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    memory: MeasurementHistory,
    effects: CompileContext,
) -> p.Budget:
    """Return the budget of an insertion, with what its looks' settings bear."""
    left, goal = left_of(task, states, insert, memory), share_of_goal(task)
    job = insertion_of(task, states, insert, left, memory.seen)
    if job is None:
        return empty_budget()
    methods = _other_methods(memory)
    budget = effects.memo.call(insert_budget, job, left, goal=goal, methods=methods)
    mates = [owner_of(n or "") for n in (insert.step.target, insert.step.onto)]
    looks = [
        (memory.seen[mate].term, memory.looks[mate])
        for mate in mates
        if mate in memory.looks
    ]
    borne = allowable_errors(task, job, goal, looks, effects)
    if budget.analysis is None:
        raise ValueError("the budget of an insertion has an analysis")
    return replace(budget, analysis=replace(budget.analysis, allowed=borne))


def _other_methods(memory: MeasurementHistory) -> list[tuple[str, float]]:
    """Return the ways to align that were not taken, with their chances."""
    if memory.choice is None:
        return []
    return [
        (option.method, option.success_probability)
        for option in memory.choice.options
        if option.method != memory.choice.method
        and option.success_probability is not None
    ]


def left_of(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    memory: MeasurementHistory,
) -> LateralResidual:
    """Return what the alignment before an insertion leaves.

    Without one nothing is cut off: all that is known of both parts' places is left.
    """
    aligns = [s for s in states if s.step.verb == "align"]
    align = next((s for s in aligns if insertion_after(states, s) is insert.step), None)
    if align is None:
        parts = [owner_of(n or "") for n in (insert.step.target, insert.step.onto)]
        since = "since something last moved sideways"
        return unaligned(insert.before, parts, since)
    method = method_taken(align, memory)
    return residual_after(task, align, method, memory.within_um, memory.before)
