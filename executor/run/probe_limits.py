"""What a probe may do: how the axes scatter, and what forbids a move."""

from __future__ import annotations

import math

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import check_step, check_travel, targets
from microplan.executor.run.run_context import Rig
from microplan.executor.run.verify import in_view
from microplan.schemas.plan import AlignAction, AxesName, AxisMove, Look

CLEAR = 3.0  # sigmas that a probe stays away from everything
# A tolerance below .6 move sigmas is refused by the compiler.
TOLERANCE_PER_SIGMA = 0.6


def steers_angle(rig: Rig, axes: AxesName) -> bool:
    """Return whether an alignment of the plan corrects an angle by these axes."""
    return any(
        isinstance(step.action, AlignAction)
        and step.action.axes == axes
        and step.control is not None
        and step.control.tolerance_theta_rad is not None
        for step in rig.plan.steps
    )


def axis_sigma_um(rig: Rig, axes: AxesName) -> float:
    """Return one sigma per axis of where an axis group lands.

    As the plan tells; else the most that its alignments' tolerances allow.
    """
    told = rig.plan.requirements.repeatability_um
    if told is not None and axes in told:
        return told[axes]
    tolerances = [
        step.control.tolerance_xy_um
        for step in rig.plan.steps
        if isinstance(step.action, AlignAction)
        and step.action.axes == axes
        and step.control is not None
    ]
    return min(tolerances, default=0.0) / TOLERANCE_PER_SIGMA


def in_the_way(rig: Rig, look: Look, move: AxisMove) -> str:
    """Return what forbids a probe's move, "" if nothing does.

    Besides limits and steps a probe stays clear of everything by CLEAR sigmas, also of
    what it is meant to touch later. Where the plan tells no room, nothing may be held
    and the tool must be out of view.
    """
    axes = move.axes
    try:
        check_travel(axes, targets(move), rig.station.offer.travel)
        limit = rig.station.rules.safety.phase(rig.phase)
        check_step(move, rig.readings().reading(axes), rig.phase, limit)
    except ExecutorError as error:
        return error.message
    if not rig.keep_out.known:
        return _near_tool(rig, look)
    spread_um = max(belief.sigma_xy_um for belief in rig.plan.beliefs)
    margin_um = CLEAR * math.hypot(spread_um, axis_sigma_um(rig, axes))
    met = rig.keep_out.met(move, rig.moment(), margin_um=margin_um)
    if met is None:
        return ""
    return f"{met[0]} would come nearer than {margin_um:.3g} um to {met[1]}"


def _near_tool(rig: Rig, look: Look) -> str:
    """Return whether a tool holds something or is in view; "" if neither."""
    for belief in rig.plan.beliefs:
        if rig.station.robot is None or belief.carrier != "robot":
            continue
        grip = rig.beliefs.world(belief.name, rig.readings())
        held = rig.beliefs.held_by(belief.name)
        if held or in_view(grip, look.view.field_um):
            return f"{belief.name} is near"
    return ""
