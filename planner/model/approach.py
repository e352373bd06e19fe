"""The first approach of an alignment: where it ends, and a way that touches nothing."""

from __future__ import annotations

import math
from dataclasses import replace

from planner.diagnostics import Report
from planner.inputs.task import Step, Task
from planner.model.assembly import (
    Axis4,
    Carrier,
    Place,
    State,
    axes_of,
    locate_place,
    owner_of,
)
from planner.model.sweep import SIGMAS, Box, sweep_hits

# Order of the axes in the first approach of an alignment, cheapest first.
PATHS = (("xy",), ("x", "y"), ("y", "x"))


def approach(
    task: Task, state: State, step: Step, report: Report
) -> tuple[State, tuple[str, ...]]:
    """Return the state with the target at its goal, and a path that touches nothing."""
    target = locate_place(task, state, step.target or "")
    goal = locate_place(task, state, step.to or "")
    shift = (goal.pose.x_um - target.pose.x_um, goal.pose.y_um - target.pose.y_um)
    after = _aligned(task, state, target, goal, shift)
    hits = {path: _path_hits(task, state, target, shift, path) for path in PATHS}
    for path in PATHS:
        if not hits[path]:
            return after, path
    moving, still = hits[PATHS[0]][0]
    report.refuse(
        "MP303",
        step.where,
        f"step {step.id!r}: {moving} would touch {still} at 2 sigma on every path to "
        f"{step.to} (straight, x then y, y then x)",
        _way_out(task, moving, still),
    )
    return after, PATHS[0]


def _way_out(task: Task, moving: str, still: str) -> str:
    """Return what may clear the way: only open fingers can be opened further."""
    tools = {owner_of(name) for name in (moving, still)} & set(task.workcell.tools)
    if tools:
        return "open the jaws further, or start from another side"
    return (
        "pass above: move the stage or robot in z in an earlier step, or start from "
        "another side"
    )


def _aligned(
    task: Task, state: State, target: Place, goal: Place, shift: tuple[float, float]
) -> State:
    """Return the state after the carrier of `target` moved by `shift`."""
    if target.carrier == "robot":
        return replace(state, robot=_shifted(state.robot, shift))
    axes = axes_of(task, target.carrier)
    spread = math.hypot(goal.sigma_xy_um, axes.repeatability_xy_um)
    return replace(
        state,
        stage=_shifted(state.stage, shift),
        stage_sigma_um=math.hypot(spread, target.sigma_xy_um),
        pinned={target.owner: spread},
    )


def _path_hits(
    task: Task,
    state: State,
    target: Place,
    shift: tuple[float, float],
    path: tuple[str, ...],
) -> tuple[tuple[str, str], ...]:
    """Return the pairs that would touch on the way.

    The target starts anywhere within two sigma of its nominal place and ends at the
    goal: each leg takes up the deviation along its own axes.
    """
    rest = axes_of(task, target.carrier).repeatability_xy_um * SIGMAS
    left = [SIGMAS * target.sigma_xy_um] * 2
    here, found = state, []
    for leg in path:
        deviation: Box = (-left[0], -left[1], left[0], left[1])
        to = (shift[0] if "x" in leg else 0.0, shift[1] if "y" in leg else 0.0)
        there = _carried(here, target.carrier, to)
        hits = sweep_hits(
            task, here, there, carrier=target.carrier, deviation=deviation
        )
        found += [(hit.moving, hit.still) for hit in hits]
        left = [
            rest if axis in leg else value
            for axis, value in zip("xy", left, strict=True)
        ]
        here = there
    return tuple(found)


def _carried(state: State, carrier: Carrier, shift: tuple[float, float]) -> State:
    """Return the state with one carrier shifted."""
    if carrier == "robot":
        return replace(state, robot=_shifted(state.robot, shift))
    return replace(state, stage=_shifted(state.stage, shift))


def _shifted(axis: Axis4, shift: tuple[float, float]) -> Axis4:
    """Return the readings moved sideways by `shift`."""
    return replace(axis, x_um=axis.x_um + shift[0], y_um=axis.y_um + shift[1])
