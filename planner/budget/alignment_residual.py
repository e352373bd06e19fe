"""Lateral residual of an alignment by one correction or a servo."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

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
from microplan.planner.budget.insertion import AngleLeft, LateralResidual
from microplan.planner.budget.probability.angle_budget import AngleCorrection
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import gain_of, moved_by, settled_theta_rad
from microplan.schemas.plan.verdicts import MethodName


def residual_after(
    task: Task,
    align: StepState,
    method: MethodName,
    within_um: float,
    before: PastMeasurement | None,
) -> LateralResidual:
    """Return the lateral residual of an alignment.

    A servo may end at its first look: then the error is that of the approach, by the
    look before, cut off at the tolerance. Every later look follows a correction,
    e+ = (1 - g) e + the axes' own. A correction that turns swings the target about the
    axes: that of a servo does where the angle is outside its tolerance.

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
    """
    angle = angle_correction(task, align, before)
    if method == "look_then_move":
        return _after_one_move(task, align, angle)
    known_um, start_um = approach_um(task, align, before)
    first = Residual(sigma_um=start_um, within_um=within_um)
    settled = residual_of(task, within_um, moved_by(task, align))
    later_um = math.hypot(settled.sigma_um, (1 - gain_of(task)) * start_um)
    later = Residual(sigma_um=later_um, within_um=within_um)
    turns = 0.0 if angle is None else angle.turns
    ends = first.inside * (1 - turns)
    left = LateralResidual(
        residual=later,
        early=(ends, first),
        term=f"{moved_by(task, align)} place left by the servo",
        source=f"workcell repeatability_xy_um, cut off at {within_um:.3g} um; with "
        f"{ends:.3g} the first look ends it, by the look before ({known_um:.3g} um)",
    )
    if angle is None:
        return left
    swung = replace(later, sigma_um=math.hypot(later_um, swing_um(task, align)))
    seen = AngleLeft(
        sigma_rad=max(angle.start_rad, angle.sigma_rad), within_rad=angle.within_rad
    )
    return replace(left, turned=(turns, swung), angle=seen)


def _after_one_move(
    task: Task, align: StepState, angle: AngleCorrection | None
) -> LateralResidual:
    """Return what one look and one correction leave, and its turn."""
    carrier = moved_by(task, align)
    left = LateralResidual(
        residual=single_residual(task, carrier),
        term=f"{carrier} repeatability left by two moves",
        source="workcell repeatability_xy_um, nothing cut off",
    )
    if angle is None:
        return left
    swung_um = math.hypot(left.residual.sigma_um, swing_um(task, align))
    return replace(
        left,
        residual=replace(left.residual, sigma_um=swung_um),
        source="workcell repeatability_xy_um and repeatability_theta_arcsec over the "
        "distance from the axis, nothing cut off",
        angle=AngleLeft(sigma_rad=angle.sigma_rad, within_rad=math.inf),
    )


def angle_correction(
    task: Task, align: StepState, before: PastMeasurement | None
) -> AngleCorrection | None:
    """Return the rotation that an alignment corrects, None if it corrects none.

    `before` as in `residual_after`: it may know the angle of one of the two.
    """
    within_rad = align.step.tolerance_theta_rad
    if within_rad is None:
        return None
    carrier = moved_by(task, align)
    sigma = axes_of(task, carrier).repeatability_theta_rad
    spread = [
        _angle_rad(task, align, name or "", before)
        for name in (align.step.target, align.step.to)
    ]
    return AngleCorrection(
        within_rad=within_rad,
        start_rad=math.hypot(*spread, math.sqrt(2) * sigma),
        sigma_rad=settled_theta_rad(task, carrier),
    )


def _angle_rad(
    task: Task, align: StepState, name: str, before: PastMeasurement | None
) -> float:
    """Return how well an angle is known before an alignment's first look, rad."""
    spread = locate_place(task, align.before, name).sigma_theta_rad
    if before is None or before.sigma_theta_rad is None:
        return spread
    is_seen = owner_of(before.name) == owner_of(name)
    return min(spread, before.sigma_theta_rad) if is_seen else spread


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
    return known_um, math.hypot(landed_um, known_um, swing_um(task, align))


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


def swing_um(task: Task, align: StepState) -> float:
    """Return the displacement by rotations that do not repeat, one sigma, um.

    Before and after a correction that turns; 0 for one that may not.
    """
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
