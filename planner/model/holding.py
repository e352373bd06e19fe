"""Taking a part between the jaws, and letting go of it."""

from __future__ import annotations

import math
from dataclasses import replace

from planner.diagnostics import Report
from planner.inputs.task import Step, Task
from planner.model.assembly import (
    PartState,
    State,
    carrier_pose,
    locate_place,
    owner_of,
    part_pose,
    part_sigma_um,
    stage_pose,
    with_part,
)
from planner.model.shapes import squeeze_minima_rad, squeeze_width_um
from planner.model.sweep import SIGMAS
from schemas.pose import Pose


def grasp(task: Task, state: State, step: Step, report: Report) -> State:
    """Return the state with the part between the jaws, centred and turned flat."""
    name, tool = owner_of(step.target or ""), task.workcell.tools[step.tool or ""]
    part = task.parts[name]
    grip = locate_place(task, state, f"{tool.name}.grip").pose
    world = part_pose(task, state, name)
    local = grip.inverse().compose(world)
    turn = _nearest(squeeze_minima_rad(part.outline), local.theta_rad)
    _check_grasp(task, state, step, report, local=local, turn_rad=turn)
    minima = squeeze_minima_rad(part.outline)
    sigma_theta = math.pi / max(len(minima), 1) / 2 / math.sqrt(3)
    held = PartState(
        carrier="robot",
        pose=Pose(x_um=0.0, y_um=local.y_um, theta_rad=turn),
        z_um=state.parts[name].z_um
        + state.stage.z_um
        + task.workcell.stage.datum_z_um
        - state.robot.z_um,
        sigma_xy_um=part_sigma_um(task, state, name),
        sigma_z_um=task.workcell.stage.axes.repeatability_z_um,
        sigma_theta_rad=math.pi
        if state.parts[name].sigma_theta_rad >= math.pi
        else sigma_theta,
    )
    lost = frozenset(n for n in state.located if owner_of(n) != name)
    return replace(
        with_part(state, name, held),
        held=name,
        opening_um=step.opening_um or 0.0,
        located=lost,
        pinned={k: v for k, v in state.pinned.items() if k != name},
    )


def _check_grasp(
    task: Task,
    state: State,
    step: Step,
    report: Report,
    *,
    local: Pose,
    turn_rad: float,
) -> None:
    """Report jaws that cannot close on the part."""
    name, tool = owner_of(step.target or ""), task.workcell.tools[step.tool or ""]
    where = step.spans.get("opening_um", step.where)
    width = squeeze_width_um(task.parts[name].outline, turn_rad)
    opening = step.opening_um or 0.0
    if opening >= width:
        report.refuse(
            "MP304",
            where,
            f"step {step.id!r}: jaws closed to {opening:g} um do not hold {name}, "
            f"which is {width:.4g} um wide where it is narrowest",
            f"close to less than {width:.4g} um",
        )
    room = (state.opening_um - width) / 2 - abs(local.x_um)
    spread = SIGMAS * part_sigma_um(task, state, name)
    if room < spread:
        report.refuse(
            "MP304",
            step.where,
            f"step {step.id!r}: {name} ({width:.4g} um) between jaws "
            f"{state.opening_um:g} um apart leaves {room:.3g} um a side, "
            f"{spread:.3g} um needed at 2 sigma",
            "open the jaws further before, or align more finely",
        )
    if local.y_um < -tool.grip_from_tip_um:
        report.refuse(
            "MP305",
            step.where,
            f"step {step.id!r}: {name} lies {-local.y_um:.3g} um before the grip, "
            f"beyond the tips at {tool.grip_from_tip_um:g} um",
            f"align it to {tool.name}.grip first",
        )


def release(task: Task, state: State, step: Step, report: Report) -> State:  # noqa: ARG001
    """Return the state with the part left where it is, on the stage."""
    name = owner_of(step.target or "")
    part = state.parts[name]
    opening = step.opening_um or state.opening_um
    world = carrier_pose(task, state, "robot").compose(part.pose)
    left = replace(
        part,
        carrier="stage",
        pose=stage_pose(task, state.stage).inverse().compose(world),
        z_um=state.robot.z_um
        + part.z_um
        - state.stage.z_um
        - task.workcell.stage.datum_z_um,
    )
    pinned = {**state.pinned, name: part_sigma_um(task, state, name)}
    opened = replace(state, held=None, opening_um=opening, pinned=pinned)
    return with_part(opened, name, left)


def _nearest(turns: tuple[float, ...], theta_rad: float) -> float:
    """Return the turn (modulo pi) nearest to `theta_rad`; itself if there is none."""
    if not turns:
        return theta_rad

    def away(turn: float) -> float:
        return math.remainder(turn - theta_rad, math.pi)

    return theta_rad + min((away(t) for t in turns), key=abs)
