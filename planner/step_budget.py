"""The error budget of one step, from what earlier looks and alignments leave."""

from __future__ import annotations

import math

from planner.checks.budget import (
    blind_rows,
    empty_budget,
    fit_of,
    grasp_budget,
    release_budget,
    verify_budget,
)
from planner.checks.fit import Residual
from planner.checks.insert_budget import Left, insert_budget, share_of_goal
from planner.control import (
    insert_s,
    moved_by,
    residual_of,
    single_residual,
    travel_of,
)
from planner.inputs.task import Task
from planner.memory import Memory
from planner.model.assembly import locate_place, owner_of, part_sigma_um
from planner.model.requests import insertion_after
from planner.model.steps import StepState
from planner.model.sweep import ROUNDING_UM
from schemas import plan as p


def budget_of(
    task: Task, states: tuple[StepState, ...], here: StepState, memory: Memory
) -> p.Budget:
    """Return the error budget of the step's mechanical action."""
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
    fit = fit_of(task, here)
    if fit is None:
        return empty_budget()
    hole = memory.seen.get(owner_of(step.target or ""))
    shaft = memory.seen.get(owner_of(step.onto or ""))
    return insert_budget(
        task,
        fit,
        _left(task, states, here, memory),
        blind_rows(task.workcell, travel_of(here), hole, shaft, insert_s(task, here)),
        bias_um=_off_um(task, here),
        goal=share_of_goal(task),
        seen=(hole, shaft),
        methods=_other_methods(memory),
    )


def _other_methods(memory: Memory) -> list[tuple[str, float]]:
    """Return the ways to align that were not taken, with their chances."""
    if memory.choice is None:
        return []
    return [
        (option.method, option.success_probability)
        for option in memory.choice.options
        if option.method != memory.choice.method
        and option.success_probability is not None
    ]


def _off_um(task: Task, insert: StepState) -> float:
    """Return how far hole and shaft are nominally apart once the moves are done."""
    hole, shaft = (
        locate_place(task, insert.after, name or "").pose
        for name in (insert.step.target, insert.step.onto)
    )
    off_um = math.hypot(hole.x_um - shaft.x_um, hole.y_um - shaft.y_um)
    return off_um if off_um > ROUNDING_UM else 0.0


def _left(
    task: Task, states: tuple[StepState, ...], insert: StepState, memory: Memory
) -> Left:
    """Return what the alignment before an insertion leaves.

    Without one nothing is cut off: all that is known of both parts' places is left.
    """
    aligns = [s for s in states if s.step.verb == "align"]
    align = next((s for s in aligns if insertion_after(states, s) is insert.step), None)
    if align is None:
        names = (insert.step.target, insert.step.onto)
        spread = [
            part_sigma_um(task, insert.before, owner_of(name or "")) for name in names
        ]
        return Left(
            residual=Residual(sigma_um=math.hypot(*spread), within_um=math.inf),
            term="places of both parts",
            source="no alignment since something last moved sideways",
        )
    carrier = moved_by(task, align)
    method = align.step.method if memory.choice is None else memory.choice.method
    if method == "look_then_move":
        return Left(
            residual=single_residual(task, carrier),
            term=f"{carrier} repeatability left by two moves",
            source="workcell repeatability_xy_um, nothing cut off",
        )
    return Left(
        residual=residual_of(task, memory.within_um, carrier),
        term=f"{carrier} repeatability left by the servo",
        source=f"workcell repeatability_xy_um, cut off at {memory.within_um:.3g} um",
    )
