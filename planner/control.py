"""How an alignment is run: tolerance, gain, expected looks and time."""

from __future__ import annotations

import math
from collections.abc import Mapping

from planner.checks.budget import Sighted, blind_rows, fit_of
from planner.checks.fit import (
    LEAST_SIGMAS,
    Residual,
    combine,
    expected_looks,
    gain_limit,
    servo_tolerance_um,
)
from planner.diagnostics import Report
from planner.inputs.task import Task
from planner.model.assembly import Carrier, axes_of, locate_place
from planner.model.requests import insertion_after
from planner.model.steps import StepState
from planner.model.views import SEARCH_SIGMAS
from schemas.plan import Control

# The chance that a servo needs more looks than this is below 1e-6.
GIVE_UP = 1e-6
# Without a fit or a stated tolerance: what axes reach within two looks on average.
DEFAULT_SIGMAS = 1.2


def tolerance_um(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    seen: Sighted | None,
    report: Report,
) -> float:
    """Return how closely to align: as stated, from the fit, or what the axes can do.

    `seen` is what the look at the goal promised, if there was one. Reports a tolerance
    that what moves can hardly meet.
    """
    step, carrier = align.step, moved_by(task, align)
    sigma = axes_of(task, carrier).repeatability_xy_um
    found = step.tolerance_xy_um or _from_fit(task, states, align, seen)
    if found is None:
        found = DEFAULT_SIGMAS * sigma
    if found < LEAST_SIGMAS * sigma:
        report.refuse(
            "MP603",
            step.spans.get("tolerance_xy_um", step.where),
            f"step {step.id!r}: a tolerance of {found:.3g} um is below {LEAST_SIGMAS} "
            f"of the {carrier}'s repeatability of {sigma:.3g} um: it would take "
            f"{expected_looks(Residual(sigma_um=sigma, within_um=found)):.0f} moves",
            f"allow at least {LEAST_SIGMAS * sigma:.3g} um, or use a finer {carrier}",
        )
    return found


def moved_by(task: Task, align: StepState) -> Carrier:
    """Return which axes an alignment corrects: those that carry its target."""
    return locate_place(task, align.before, align.step.target or "").carrier


def control_of(task: Task, align: StepState, within_um: float) -> Control:
    """Return how the alignment is run."""
    cell, step = task.workcell, align.step
    carrier = moved_by(task, align)
    axes = axes_of(task, carrier)
    single = step.method == "look_then_move"
    residual = residual_of(task, within_um, carrier)
    looks = 1.0 if single else expected_looks(residual)
    cycle_s = axes.settle_s + 1 / cell.camera.rate_hz * (1 + cell.camera.latency_frames)
    return Control(
        # `auto` means servo until look-then-move is compared with it
        method="look_then_move" if single else "servo",
        gain=gain_of(task),
        gain_limit=gain_limit(0),
        tolerance_xy_um=within_um,
        tolerance_theta_rad=step.tolerance_theta_rad,
        max_step_um=max_step_um(task, carrier),
        max_cycles=_most_looks(residual),
        expected_cycles=looks,
        expected_s=looks * cycle_s,
    )


def residual_of(task: Task, within_um: float, carrier: Carrier) -> Residual:
    """Return what a servo that moves `carrier` leaves.

    Axes that repeat to s about their readings carry the error of the move before
    into the next correction: e+ = (1 - g) e + n - n+, whose variance settles at
    2 s**2 / (2 - g).
    """
    sigma = axes_of(task, carrier).repeatability_xy_um
    settled = sigma * math.sqrt(2 / (2 - gain_of(task)))
    return Residual(sigma_um=settled, within_um=within_um)


def single_residual(task: Task, carrier: Carrier) -> Residual:
    """Return what one correction leaves: the errors of two moves, nothing cut off."""
    sigma = axes_of(task, carrier).repeatability_xy_um
    return Residual(sigma_um=sigma * math.sqrt(2), within_um=math.inf)


def gain_of(task: Task) -> float:
    """Return the gain, at most half of what is stable.

    A frame is taken after every move has settled, so no frame is on its way.
    """
    return min(task.workcell.servo.gain, gain_limit(0) / 2)


def max_step_um(task: Task, carrier: Carrier) -> float:
    """Return the largest correction that can be honest: the range of the look."""
    sigma = math.hypot(
        axes_of(task, carrier).repeatability_xy_um,
        task.benchmark.pose_sigma_xy_um,
    )
    return 2 * SEARCH_SIGMAS * sigma


def _most_looks(residual: Residual) -> int:
    """Return how many looks fail to end inside with a chance below GIVE_UP."""
    outside = 1 - residual.inside
    if outside <= 0:
        return 2
    return max(2, math.ceil(math.log(GIVE_UP) / math.log(outside)) + 1)


def _from_fit(
    task: Task, states: tuple[StepState, ...], align: StepState, seen: Sighted | None
) -> float | None:
    """Return the tolerance that the insertion after the alignment asks for."""
    step = insertion_after(states, align)
    if step is None:
        return None
    here = next(s for s in states if s.step is step)
    fit = fit_of(task, here)
    if fit is None or fit.capture_um <= 0:
        return None
    rows = blind_rows(task.workcell, travel_of(here), seen, seen, insert_s(task, here))
    return servo_tolerance_um(
        fit,
        axes_of(task, moved_by(task, align)).repeatability_xy_um,
        combine([row.sigma_um or 0.0 for row in rows]),
        task.success_goal or 0.95,
    )


def insert_s(task: Task, insert: StepState) -> float:
    """Return how long an insertion's own moves take in z, one after the other."""
    travel = travel_of(insert)
    stated = insert.step.speed_um_per_s
    return sum(
        way_um / (stated or axes_of(task, carrier).speed_z_um_per_s)
        for carrier, way_um in travel.items()
    )


def travel_of(insert: StepState) -> Mapping[Carrier, float]:
    """Return how far stage and robot travel in z while inserting, um."""
    before, after = insert.before, insert.after
    return {
        "stage": abs(after.stage.z_um - before.stage.z_um),
        "robot": abs(after.robot.z_um - before.robot.z_um),
    }
