"""Grip of a part by the jaws: room, holding force, angle."""

from __future__ import annotations

import itertools
import math
from typing import Literal

import numpy as np
import shapely

from microplan.planner.assembly.assembly import locate_place, owner_of
from microplan.planner.assembly.holding import between_jaws, turn_miss
from microplan.planner.assembly.shapes import hull, squeeze_minima_rad, squeeze_width_um
from microplan.planner.assembly.step_states import StepState
from microplan.planner.mechanics.adhesion import (
    Bounds,
    in_liquid,
    part_forces,
    part_weight_un,
    total,
)
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.task.workcell import Tool
from microplan.schemas.plan.verdicts import GraspVerdict

SIGMAS = 3.0  # at which the part must be clear of the jaws
UN_PER_UM2_PER_GPA = 1e3  # a GPa is 1e3 uN/um2

Holds = Literal["holds", "may slip", "will slip", "unknown"]


def grasp_verdict(task: Task, here: StepState) -> GraspVerdict:
    """Return room, angle and force of a grasp."""
    step, state = here.step, here.at_look
    name = owner_of(step.target or "")
    part, tool = task.parts[name], task.workcell.tools[step.tool or ""]
    between = between_jaws(task, state, step)
    grip = locate_place(task, state, f"{tool.name}.grip")
    minima = squeeze_minima_rad(part.outline)
    squeeze = (between.width_um - (step.opening_um or 0.0)) / 2
    force = holding_un(tool, squeeze, part.profile_tolerance_um)
    lift = _lift(task, name)
    verdict, reason = _holds(force, lift, task.environment.friction)
    if verdict == "holds" and in_liquid(task.workcell.optics.medium_index):
        verdict, reason = "may slip", f"{reason}; double layers are not modelled"
    return GraspVerdict(
        opening_um=state.opening_um,
        width_um=between.width_um,
        width_range_um=_width_range(task, step, minima),
        room_um=between.room_um,
        needed_um=SIGMAS * math.hypot(between.sigma_um, grip.sigma_xy_um),
        settles=len(minima),
        theta_within_rad=widest_gap_rad(minima) / 2 if minima else None,
        theta_sigma_rad=here.after.parts[name].sigma_theta_rad,
        squeeze_um=squeeze,
        force_un=force,
        lift_un=lift,
        verdict=verdict,
        reason=reason,
        theta_miss_probability=turn_miss(task, state, step),
    )


def holding_un(tool: Tool, squeeze_um: float, edge_um: float) -> Bounds | None:
    """Return the force of one finger bent by `squeeze_um`, over the part's tolerance.

    None where the workcell states no stiffness.
    """
    per_um = stiffness_un_per_um(tool)
    if per_um is None:
        return None
    low, high = squeeze_um - edge_um, squeeze_um + edge_um
    return per_um * max(low, 0.0), per_um * max(high, 0.0)


def stiffness_un_per_um(tool: Tool) -> float | None:
    """Return what bends a finger by one micrometre, None where nothing is stated.

    A cantilever loaded at its end, E I w'' = F (L - x): 3 E I / L**3, with I =
    thickness width**3 / 12 across the finger.
    """
    if tool.youngs_modulus_gpa is None or tool.free_length_um is None:
        return None
    second = tool.thickness_um * tool.finger_width_um**3 / 12
    modulus = tool.youngs_modulus_gpa * UN_PER_UM2_PER_GPA
    return 3 * modulus * second / tool.free_length_um**3


def widest_gap_rad(minima: tuple[float, ...]) -> float:
    """Return the widest gap between angles in [0, pi) that repeat every pi."""
    ring = (*minima, minima[0] + math.pi)
    return max(after - before for before, after in itertools.pairwise(ring))


def _width_range(task: Task, step: TaskStep, minima: tuple[float, ...]) -> Bounds:
    """Return the least and greatest width of a part between flat jaws."""
    outline = task.parts[owner_of(step.target or "")].outline
    corners = shapely.get_coordinates(hull(outline))
    apart = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    turns = minima or (0.0,)
    return min(squeeze_width_um(outline, t) for t in turns), float(apart.max())


def _lift(task: Task, name: str) -> Bounds:
    """Return what lifting a part off its face takes, uN."""
    part = task.parts[name]
    low, high = total(part_forces(task, part.outline.area_um2, [name]))
    weight = part_weight_un(task, part)
    return weight[0] + low, weight[1] + high


def _holds(force: Bounds | None, lift: Bounds, friction: float) -> tuple[Holds, str]:
    """Return whether friction of both fingers carries a part off its face."""
    if force is None:
        return "unknown", "the workcell states no youngs_modulus_gpa and free_length_um"
    grip = (2 * friction * force[0], 2 * friction * force[1])
    said = (
        f"friction of two fingers carries {grip[0]:.2g}..{grip[1]:.2g} uN, lifting it "
        f"off takes {lift[0]:.2g}..{lift[1]:.2g} uN"
    )
    if grip[0] >= lift[1]:
        return "holds", said
    return ("will slip" if grip[1] < lift[0] else "may slip"), said
