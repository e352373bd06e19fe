"""The first approach of an alignment: its end, its path free of collisions."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.arrays import Box
from microplan.optics.outline.clip import grown
from microplan.planner.assembly.assembly import (
    Axis4,
    Place,
    State,
    axes_of,
    carrier_pose,
    locate_place,
    owner_of,
    planned_sigma_um,
)
from microplan.planner.assembly.swept_volume import SIGMAS, sweep_hits
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep

# Order of the axes in the first approach of an alignment, cheapest first.
PATHS = (("xy",), ("x", "y"), ("y", "x"))


def approach(
    task: Task, state: State, step: TaskStep, report: Report
) -> tuple[State, tuple[str, ...]]:
    """Return the state with the target at its goal, and a path that touches nothing.

    It is rotated to its goal, too, where the step has an angular tolerance.
    """
    target = locate_place(task, state, step.target or "")
    goal = locate_place(task, state, step.to or "")
    rotation_rad = 0.0
    if step.tolerance_theta_rad is not None:
        off_rad = goal.pose.theta_rad - target.pose.theta_rad
        rotation_rad = math.remainder(off_rad, math.tau)
    readings = _readings(task, state, target, goal, rotation_rad)
    after = _aligned(task, state, target, goal, readings)
    hits = {
        path: _path_hits(task, state, target, goal, readings, path) for path in PATHS
    }
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
    """Return what may remove the collision: only open fingers can be opened further."""
    tools = {owner_of(name) for name in (moving, still)} & set(task.workcell.tools)
    if tools:
        return "open the jaws further, or start from another side"
    return (
        "pass above: move the stage or robot in z in an earlier step, or start from "
        "another side"
    )


def _readings(
    task: Task, state: State, target: Place, goal: Place, rotation_rad: float
) -> Axis4:
    """Return the readings that bring the target to its goal, rotated by `rotation_rad`.

    The rotation swings it about the axis, which x and y compensate.
    """
    axis = state.axes(target.carrier)
    turned = replace(axis, theta_rad=axis.theta_rad + rotation_rad)
    local = carrier_pose(task, state, target.carrier).inverse().compose(target.pose)
    there = state.carried(target.carrier, turned)
    swung = carrier_pose(task, there, target.carrier).compose(local)
    return replace(
        turned,
        x_um=turned.x_um + goal.pose.x_um - swung.x_um,
        y_um=turned.y_um + goal.pose.y_um - swung.y_um,
    )


def _aligned(
    task: Task, state: State, target: Place, goal: Place, readings: Axis4
) -> State:
    """Return the state after the carrier of `target` went to `readings`.

    What lies on the stage is then near what the robot holds. The robot itself follows
    its goal: both are as far from where the plan has them.
    """
    moved = state.carried(target.carrier, readings)
    axes = axes_of(task, target.carrier)
    by_robot = target.carrier == "robot"
    lying, held = (goal, target) if by_robot else (target, goal)
    sigma_um = math.hypot(held.sigma_xy_um, axes.repeatability_xy_um)
    planned_um = planned_sigma_um(task, state, lying.owner)
    followed_um = planned_um if by_robot else state.followed_um
    return replace(
        moved,
        stage_sigma_um=math.hypot(sigma_um, planned_um),
        pinned={lying.owner: sigma_um},
        followed_um=0.0 if state.strayed_um and not by_robot else followed_um,
        strayed_um=0.0,
        stage_moved_um=0.0,
    )


def _path_hits(
    task: Task,
    state: State,
    target: Place,
    goal: Place,
    readings: Axis4,
    path: tuple[str, ...],
) -> tuple[tuple[str, str], ...]:
    """Return the pairs that would touch along a path.

    The target starts anywhere within two sigma of its nominal position and ends at the
    goal: each leg takes up the deviation along its own axes. The first leg rotates. A
    robot goes as far off as its goal is, which only the goal's own owner is, too.
    """
    rest = axes_of(task, target.carrier).repeatability_xy_um * SIGMAS
    left = [SIGMAS * target.sigma_xy_um] * 2
    axis = state.axes(target.carrier)
    here, found = state, []
    by_robot = target.carrier == "robot"
    off_um = SIGMAS * planned_sigma_um(task, state, goal.owner) if by_robot else 0.0
    for leg in path:
        deviation: Box = (-left[0], -left[1], left[0], left[1])
        axis = replace(
            axis,
            x_um=readings.x_um if "x" in leg else axis.x_um,
            y_um=readings.y_um if "y" in leg else axis.y_um,
            theta_rad=readings.theta_rad,
        )
        there = here.carried(target.carrier, axis)
        near, far = (
            sweep_hits(task, here, there, carrier=target.carrier, deviation=box)
            for box in (deviation, grown(deviation, off_um))
        )
        hits = [hit for hit in near if owner_of(hit.still) == goal.owner]
        hits += [hit for hit in far if owner_of(hit.still) != goal.owner]
        found += [(hit.moving, hit.still) for hit in hits]
        left = [
            rest if name in leg else value
            for name, value in zip("xy", left, strict=True)
        ]
        here = there
    return tuple(found)
