"""Alignments: what they move, their gain, and tolerances that axes can hardly meet."""

from __future__ import annotations

import math

from microplan.planner.assembly.assembly import Carrier, axes_of, locate_place
from microplan.planner.assembly.step_states import StepState
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task

# e+ = (1 - g) e settles below it. Every look is of a frame exposed after the move has
# settled: a camera's latency costs time and does not enter.
GAIN_LIMIT = 2.0
# Below this many sigmas of the axes a servo looks more than MOST_EXPECTED times:
# 1 / (1 - exp(-0.6**2 / 2)) = 6.07 on average.
LEAST_SIGMAS = 0.6
MOST_EXPECTED = 6.0


def moved_by(task: Task, align: StepState) -> Carrier:
    """Return the axes that an alignment corrects: those that carry its target."""
    return locate_place(task, align.before, align.step.target or "").carrier


def gain_of(task: Task) -> float:
    """Return the gain, at most half of what is stable."""
    return min(task.workcell.servo.gain, GAIN_LIMIT / 2)


def settled_theta_rad(task: Task, carrier: Carrier) -> float:
    """Return the standard deviation of an angle after a correction: of two landings."""
    return math.sqrt(2) * axes_of(task, carrier).repeatability_theta_rad


def inside_angle(within_rad: float, sigma_rad: float) -> float:
    """Return the probability that an angle is within a tolerance."""
    return math.erf(within_rad / sigma_rad / math.sqrt(2)) if sigma_rad > 0 else 1.0


def check_tolerances(task: Task, states: tuple[StepState, ...], report: Report) -> bool:
    """Return whether the axes can meet every stated tolerance; report the others.

    A tolerance that follows from a fit is never finer than LEAST_SIGMAS.
    """
    aligns = [state for state in states if state.step.verb == "align"]
    met = [
        check(task, align, report)
        for align in aligns
        for check in (_check_distance, _check_angle)
    ]
    return all(met)


def _check_distance(task: Task, align: StepState, report: Report) -> bool:
    """Return whether an alignment's distance can be met; report one that cannot."""
    step, carrier = align.step, moved_by(task, align)
    within, sigma = step.tolerance_xy_um, axes_of(task, carrier).repeatability_xy_um
    if within is None or within >= LEAST_SIGMAS * sigma:
        return True
    report.refuse(
        "MP603",
        step.spans.get("tolerance_xy_um", step.where),
        f"step {step.id!r}: a tolerance of {within:.3g} um is below {LEAST_SIGMAS} of "
        f"the {carrier}'s repeatability of {sigma:.3g} um: a servo would look more "
        f"than {MOST_EXPECTED:g} times on average",
        f"allow at least {LEAST_SIGMAS * sigma:.3g} um, or use a finer {carrier}",
    )
    return False


def _check_angle(task: Task, align: StepState, report: Report) -> bool:
    """Return whether an alignment's angle can be met; report one that cannot."""
    step, carrier = align.step, moved_by(task, align)
    within = step.tolerance_theta_rad
    if within is None:
        return True
    sigma = settled_theta_rad(task, carrier)
    inside = inside_angle(within, sigma)
    if inside * MOST_EXPECTED >= 1:
        return True
    report.refuse(
        "MP603",
        step.spans.get("tolerance_theta_deg", step.where),
        f"step {step.id!r}: a tolerance of {math.degrees(within):.3g} deg is met by "
        f"one move in {1 / inside:.0f}: the {carrier}'s angle repeats to "
        f"{math.degrees(sigma):.3g} deg",
        f"allow more, or use a finer {carrier}",
    )
    return False
