"""How an alignment is run: tolerance, gain, expected looks and time."""

from __future__ import annotations

import math

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
from planner.inputs.task import Step, Task
from planner.model.requests import insertion_after
from planner.model.steps import StepState
from planner.model.views import SEARCH_SIGMAS
from schemas.plan import Control

# The chance that a servo needs more looks than this is below 1e-6.
GIVE_UP = 1e-6
# Without a fit or a stated tolerance: what a stage reaches within two looks on average.
DEFAULT_SIGMAS = 1.2


def tolerance_um(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    seen: Sighted | None,
    report: Report,
) -> float:
    """Return how closely to align: as stated, from the fit, or what the stage can do.

    `seen` is what the look at the goal promised, if there was one. Reports a tolerance
    that the stage can hardly meet.
    """
    step, sigma = align.step, task.workcell.stage.axes.repeatability_xy_um
    found = step.tolerance_xy_um or _from_fit(task, states, align, seen)
    if found is None:
        found = DEFAULT_SIGMAS * sigma
    if found < LEAST_SIGMAS * sigma:
        report.refuse(
            "MP603",
            step.spans.get("tolerance_xy_um", step.where),
            f"step {step.id!r}: a tolerance of {found:.3g} um is below {LEAST_SIGMAS} "
            f"of the stage's repeatability of {sigma:.3g} um: it would take "
            f"{expected_looks(Residual(sigma_um=sigma, within_um=found)):.0f} moves",
            f"allow at least {LEAST_SIGMAS * sigma:.3g} um, or use a finer stage",
        )
    return found


def control_of(task: Task, step: Step, within_um: float) -> Control:
    """Return how the alignment is run."""
    cell = task.workcell
    axes = cell.stage.axes
    single = step.method == "look_then_move"
    residual = residual_of(task, within_um)
    looks = 1.0 if single else expected_looks(residual)
    cycle_s = axes.settle_s + 1 / cell.camera.rate_hz * (1 + cell.camera.latency_frames)
    return Control(
        # `auto` means servo until look-then-move is compared with it
        method="look_then_move" if single else "servo",
        gain=gain_of(task),
        gain_limit=gain_limit(0),
        tolerance_xy_um=within_um,
        tolerance_theta_rad=step.tolerance_theta_rad,
        max_step_um=max_step_um(task),
        max_cycles=_most_looks(residual),
        expected_cycles=looks,
        expected_s=looks * cycle_s,
    )


def residual_of(task: Task, within_um: float) -> Residual:
    """Return what the servo leaves.

    A stage that repeats to s about its readings carries the error of the move before
    into the next correction: e+ = (1 - g) e + n - n+, whose variance settles at
    2 s**2 / (2 - g).
    """
    sigma = task.workcell.stage.axes.repeatability_xy_um
    settled = sigma * math.sqrt(2 / (2 - gain_of(task)))
    return Residual(sigma_um=settled, within_um=within_um)


def single_residual(task: Task) -> Residual:
    """Return what one correction leaves: the errors of two moves, nothing cut off."""
    sigma = task.workcell.stage.axes.repeatability_xy_um
    return Residual(sigma_um=sigma * math.sqrt(2), within_um=math.inf)


def gain_of(task: Task) -> float:
    """Return the gain, at most half of what is stable.

    A frame is taken after every move has settled, so no frame is on its way.
    """
    return min(task.workcell.servo.gain, gain_limit(0) / 2)


def max_step_um(task: Task) -> float:
    """Return the largest correction that can be honest: the range of the look."""
    sigma = math.hypot(
        task.workcell.stage.axes.repeatability_xy_um,
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
    fit = None if step is None else fit_of(task, step)
    if step is None or fit is None or fit.capture_um <= 0:
        return None
    travel = insertion_travel_um(states, step)
    rows = blind_rows(task.workcell, travel, seen, seen)
    return servo_tolerance_um(
        fit,
        task.workcell.stage.axes.repeatability_xy_um,
        combine([row.sigma_um or 0.0 for row in rows]),
        task.success_goal or 0.95,
    )


def insertion_travel_um(states: tuple[StepState, ...], step: Step) -> float:
    """Return how far the stage travels in z while inserting."""
    here = next(s for s in states if s.step is step)
    return abs(here.after.stage.z_um - here.before.stage.z_um)
