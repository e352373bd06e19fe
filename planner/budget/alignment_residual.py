"""Lateral residual of an alignment by one correction or a servo."""

from __future__ import annotations

import math
from collections.abc import Iterable

from microplan.planner.assembly.assembly import (
    Carrier,
    State,
    axes_of,
    locate_place,
    owner_of,
    part_sigma_um,
)
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insertion import LateralResidual
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import gain_of, moved_by
from microplan.schemas.plan.verdicts import MethodName


def residual_after(
    task: Task,
    align: StepState,
    method: MethodName,
    within_um: float,
    before: PastMeasurement | None,
    turned: float = 1.0,
) -> LateralResidual:
    """Return the lateral residual of an alignment.

    A servo may end at its first look: then the error is that of the approach, by the
    look before, cut off at the tolerance. Every later look follows a correction,
    e+ = (1 - g) e + the axes' own.

    Parameters
    ----------
    task, align : Task, StepState
        The alignment.
    method : str
        How it is run.
    within_um : float
        Its tolerance.
    before : PastMeasurement or None
        The look that its approach goes by; None: the target's position as the task has
        it.
    turned : float
        Chance that the angle is within its tolerance at the first look.
    """
    carrier = moved_by(task, align)
    if method == "look_then_move":
        return LateralResidual(
            residual=single_residual(task, carrier),
            term=f"{carrier} repeatability left by two moves",
            source="workcell repeatability_xy_um, nothing cut off",
        )
    known_um, start_um = approach_um(task, align, before)
    first = Residual(sigma_um=start_um, within_um=within_um)
    settled = residual_of(task, within_um, carrier)
    later_um = math.hypot(settled.sigma_um, (1 - gain_of(task)) * start_um)
    share = first.inside * turned
    return LateralResidual(
        residual=Residual(sigma_um=later_um, within_um=within_um),
        early=(share, first),
        term=f"{carrier} place left by the servo",
        source=f"workcell repeatability_xy_um, cut off at {within_um:.3g} um; with "
        f"{share:.3g} the first look ends it, by the look before ({known_um:.3g} um)",
    )


def approach_um(
    task: Task, align: StepState, before: PastMeasurement | None
) -> tuple[float, float]:
    """Return sigma of an approach's goal, and of where it ends, um.

    It goes by the look before, whose zoom it keeps: of the zoom's scale, the workcell's
    own sigma moves the position seen, not that of the trials.
    """
    known_um = (
        part_sigma_um(align.before, owner_of(align.step.target or ""))
        if before is None
        else _seen_um(task, before)
    )
    landed_um = single_residual(task, moved_by(task, align)).sigma_um
    return known_um, math.hypot(landed_um, known_um, _swing_um(task, align))


def _seen_um(task: Task, before: PastMeasurement) -> float:
    """Return sigma of a look, um, the zoom's scale as the workcell has it."""
    if before.sigma_without_scale_um is None:
        return before.sigma_um
    scale = task.workcell.optics.zoom.scale_sigma
    away_um = scale * math.hypot(*before.place_um)
    return min(before.sigma_um, math.hypot(before.sigma_without_scale_um, away_um))


def unaligned(state: State, parts: Iterable[str], since: str) -> LateralResidual:
    """Return the lateral residual without an alignment: the parts' own errors."""
    spread = [part_sigma_um(state, name) for name in parts]
    return LateralResidual(
        residual=Residual(sigma_um=math.hypot(*spread), within_um=math.inf),
        term="places of both parts",
        source=f"no alignment {since}",
    )


def residual_of(task: Task, within_um: float, carrier: Carrier) -> Residual:
    """Return the residual of a servo that moves `carrier`.

    Axes that repeat to s about their readings carry the error of the move before
    into the next correction: e+ = (1 - g) e + n - n+, whose variance settles at
    2 s**2 / (2 - g).
    """
    sigma = axes_of(task, carrier).repeatability_xy_um
    settled = sigma * math.sqrt(2 / (2 - gain_of(task)))
    return Residual(sigma_um=settled, within_um=within_um)


def single_residual(task: Task, carrier: Carrier) -> Residual:
    """Return the residual of one correction: the errors of two moves, not cut off."""
    sigma = axes_of(task, carrier).repeatability_xy_um
    return Residual(sigma_um=sigma * math.sqrt(2), within_um=math.inf)


def _swing_um(task: Task, align: StepState) -> float:
    """Return the displacement by rotations that do not repeat, one sigma, um."""
    if align.step.tolerance_theta_rad is None:
        return 0.0
    carrier = moved_by(task, align)
    target = locate_place(task, align.at_look, align.step.target or "").pose
    arm_um = task.workcell.robot.theta_axis_to_tip_um
    if carrier == "stage":
        stage, axis = align.at_look.stage, task.workcell.stage.theta_axis_um
        arm_um = math.hypot(
            target.x_um - stage.x_um - axis[0], target.y_um - stage.y_um - axis[1]
        )
    return math.sqrt(2) * axes_of(task, carrier).repeatability_theta_rad * arm_um
