"""Lower bound of a plan's P(success), and more trials until it decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.lower_bound.run_bound import (
    CONFIDENCE,
    BoundedRun,
    success_bound,
)
from microplan.planner.budget.lower_bound.step_bounds import MeasuredStep
from microplan.planner.plan.steps import CompiledStep
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.summary import left_out
from microplan.planner.task.presets import Effort
from microplan.planner.task.task import Task
from microplan.schemas import plan as p
from microplan.schemas.page.figures import chance

MOST_TRIALS = 8192  # random ones of a look, that a bound asks for


def bound_of(
    task: Task,
    states: tuple[StepState, ...],
    steps: Sequence[CompiledStep],
    confidence: float | None,
) -> p.SuccessBound:
    """Return what the success probability of all steps is at least."""
    pairs = zip(states, steps, strict=True)
    told = tuple(
        (
            step.step,
            MeasuredStep(task=task, states=states, here=here, history=step.history),
        )
        for here, step in pairs
    )
    run = BoundedRun(steps=told, confidence=confidence or CONFIDENCE)
    found = tuple(step.step for step in steps)
    return success_bound(run, task.success_goal, left_out(found))


def more_trials(
    plan: p.Plan, effort: Effort, confidence: float | None
) -> Effort | None:
    """Return the effort that may decide whether the bound meets the goal.

    None where nobody asks for the confidence, it is decided, or not even `MOST_TRIALS`
    would decide.
    """
    bound, goal = plan.success_bound, plan.success_goal
    if bound is None or goal is None or confidence is None:
        return None
    needed = bound.trials_needed
    if bound.success_low >= goal or needed is None or needed > MOST_TRIALS:
        return None
    return replace(effort, random_trials=max(needed, 2 * effort.random_trials))


def report_unshown(
    task: Task, success: float, bound: p.SuccessBound, report: Report
) -> None:
    """Report a success probability that meets the goal, and its bound that does not."""
    goal = task.success_goal
    if goal is None or success < goal or bound.success_low >= goal:
        return
    report.refuse(
        "MP616",
        task.where.get("goal.success_probability", task.where["goal"]),
        f"P(success) is {chance(success)}, but at {bound.confidence:g} confidence no "
        f"more is shown than {chance(bound.success_low)}, the goal {goal:g}: steps "
        f"{chance(bound.mechanical_low)} with sigmas and biases at their ends, less "
        f"{bound.undetected_upper:.3g} for looks that are wrong without a word, by "
        f"{bound.trials} random trials of a look",
        _hint(bound),
    )


def _hint(bound: p.SuccessBound) -> str:
    """Return what would show the goal."""
    if bound.trials_needed is None:
        widest = max(bound.biases, key=lambda row: row.half_width_um, default=None)
        if widest is None or widest.half_width_um <= 0:
            return "no number of trials would show it: ask for less confidence"
        return (
            "no number of trials would show it; the widest bias is that of the "
            f"{widest.term}, {widest.half_width_um:.3g} um: ask for less confidence, "
            "or state less uncertainty"
        )
    return (
        f"{bound.trials_needed} trials of each look would show it if they found the "
        f"same, more than the {MOST_TRIALS} that are made: ask for less confidence"
    )
