"""Grasp of a part: the angle to which the jaws turn it, then their motion."""

from __future__ import annotations

import math

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.run_context import Rig
from microplan.schemas.plan import AlignAction, GraspAction, Step

# Probability of another rest angle up to which the nearest is believed: the compiler
# refuses more (MP310), so that the spreads which a plan states stop no run.
UNSURE = 1e-3


def grasp(rig: Rig, step: Step, action: GraspAction) -> None:
    """Close the jaws on a part, and believe it where they leave it.

    Raises
    ------
    ExecutorError
        MP824 before they move, if they may turn the part either way and a later
        alignment needs its angle.
    """
    later = _needing_angle(rig, step, action.target)
    if action.rests and later is not None:
        _check_turn(rig, action, later)
    rig.grip(action.opening_um)
    rig.beliefs.grasp(
        action.target, action.tool, rig.readings(), action.across_um, action.rests
    )


def _needing_angle(rig: Rig, step: Step, part: str) -> Step | None:
    """Return the first later step that aligns the angle of a part, None without one."""
    steps, owner = rig.plan.steps, rig.beliefs.owner
    for later in steps[steps.index(step) + 1 :]:
        action, control = later.action, later.control
        if control is None or control.tolerance_theta_rad is None:
            continue
        if not isinstance(action, AlignAction):
            continue
        if owner(part) in (owner(action.target), owner(action.to)):
            return later
    return None


def _check_turn(rig: Rig, action: GraspAction, later: Step) -> None:
    """Raise if a part may come to rest at another angle than the nearest."""
    part, tool, readings = action.target, action.tool, rig.readings()
    found = rig.beliefs.squeezed(part, tool, readings, action.rests)
    if found is None or found.elsewhere <= UNSURE:
        return
    raise ExecutorError(
        "MP824",
        f"closing jaws turn {part} to {math.degrees(found.theta_rad):.4g} deg in "
        f"{tool}, or, with probability {found.elsewhere:.2g}, to another angle; "
        f"{later.id} needs its angle",
    )
