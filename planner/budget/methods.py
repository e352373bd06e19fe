"""The method of an alignment: a servo, or one look and one correction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from microplan.optics.outline.tolerant_order import least
from microplan.planner.assembly.assembly import axes_of, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import (
    angle_correction,
    approach_um,
    residual_after,
    residual_of,
    swing_um,
)
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insert_budget import insertion_of, share_of_goal
from microplan.planner.budget.probability.servo_landing import Loop, expected_looks
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import gain_of, moved_by
from microplan.planner.views.requests import insertion_after
from microplan.schemas.page.figures import chance
from microplan.schemas.plan.verdicts import MethodChoice, MethodName, MethodOption

# Probabilities that differ by less are equal: the quicker method is taken.
SAME_PROBABILITY = 1e-6
METHODS: tuple[MethodName, ...] = ("servo", "look_then_move")


def method_of(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    within_um: float,
    seen: Mapping[str, PastMeasurement],
    report: Report,
    before: PastMeasurement | None = None,
) -> MethodChoice:
    """Return the method of an alignment: as the task asks, else the best one.

    `seen` are the looks by owner, `before` is the one that the approach goes by. What
    was chosen is reported.
    """
    step, insert = align.step, insertion_after(states, align)
    options = tuple(
        _option(task, states, align, within_um, method, seen, before)
        for method in METHODS
    )
    found = choose(options, share_of_goal(task), "" if insert is None else insert.id)
    if step.method != "auto":
        return replace(
            found, asked=step.method, method=step.method, reason="the task asks for it"
        )
    if insert is not None:
        report.fact(
            "MP612",
            step.spans.get("method", step.where),
            f"step {step.id!r}: aligned by {found.method}: it {found.reason}",
            "'servo' looks after every move, 'look_then_move' once: state one as "
            "'method' to decide yourself",
        )
    return found


def _option(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    within_um: float,
    method: MethodName,
    seen: Mapping[str, PastMeasurement],
    before: PastMeasurement | None,
) -> MethodOption:
    """Return a method's looks and time, and the probability of a later insertion."""
    insert = insertion_after(states, align)
    success = None
    if insert is not None:
        left = residual_after(task, align, method, within_um, before)
        here = next(s for s in states if s.step is insert)
        job = insertion_of(task, states, here, left, seen)
        success = None if job is None else 1 - job.miss
    cell, axes = task.workcell, axes_of(task, moved_by(task, align))
    looks = 1.0
    if method == "servo":
        looks = _servo_looks(task, align, within_um, seen, before)
    cycle_s = axes.settle_s + 1 / cell.camera.rate_hz * (1 + cell.camera.latency_frames)
    return MethodOption(
        method=method,
        success_probability=success,
        looks=looks,
        expected_s=looks * cycle_s,
    )


def _servo_looks(
    task: Task,
    align: StepState,
    within_um: float,
    seen: Mapping[str, PastMeasurement],
    before: PastMeasurement | None,
) -> float:
    """Return how many looks a servo takes on average."""
    carrier, angle = moved_by(task, align), angle_correction(task, align, before)
    here = seen.get(owner_of(align.step.target or ""))
    _, start_um = approach_um(task, align, before)
    # along one direction; of a loop that is alike in all, as much in the mean
    swung_um = swing_um(task, align) / math.sqrt(2)
    start_um = math.sqrt(max(start_um**2 - swung_um**2, 0.0))
    look_um = 0.0
    if here and here.step == align.step.id:  # its trueness stays from look to look
        look_um = math.sqrt(max(here.sigma_um**2 - here.trueness_um**2, 0.0))
    loop = Loop(
        gain=gain_of(task),
        move_um=axes_of(task, carrier).repeatability_xy_um,
        look_um=look_um,
        start_um=start_um,
        within_um=within_um,
    )
    looks = expected_looks(loop)
    if angle is None or angle.inside <= 0:
        return looks
    # what turns is out of place by the swing of that, and is not turned again inside
    left_um = residual_of(task, within_um, carrier).sigma_um
    near = replace(loop, start_um=math.hypot(left_um, swung_um))
    turned = angle.turns * expected_looks(near)
    return (1 - angle.turns) * looks + angle.expected + turned


def choose(
    options: Sequence[MethodOption], goal: float, where: str = ""
) -> MethodChoice:
    """Return the quickest method that meets `goal`, else the most probable one.

    Parameters
    ----------
    options : sequence of MethodOption
        At least one; without probabilities (no insertion follows) the servo is taken,
        which alone looks again whether it is inside the tolerance.
    goal : float
        The insertion's share of the task's goal.
    where : str
        Named in the reason: the insertion.

    Raises
    ------
    ValueError
        If there is nothing to choose from.
    """
    if not options:
        raise ValueError("a choice needs at least one option")
    known = [(o.success_probability, o) for o in options]
    rated = [(success, o) for success, o in known if success is not None]
    if len(rated) < len(options):
        servo = next((o for o in options if o.method == "servo"), options[0])
        reason = "no insertion follows; a servo alone sees that it is within tolerance"
        return _chosen(servo, options, reason)
    enough = [o for success, o in rated if success >= goal]
    said = "meets" if len(enough) == 1 else "is the quickest to meet"
    if not enough:
        top = max(success for success, _ in rated)
        enough = [o for success, o in rated if success >= top - SAME_PROBABILITY]
        said = "comes nearest to"
    words = ", ".join(
        f"{o.method} P {chance(o.success_probability)} in {o.expected_s:.2g} s"
        for o in options
    )
    # the first by name of those as quick
    best = least(sorted(enough, key=lambda o: o.method), lambda o: o.expected_s)
    return _chosen(best, options, f"{said} {goal:.4g} at {where}: {words}")


def _chosen(
    option: MethodOption, options: Sequence[MethodOption], reason: str
) -> MethodChoice:
    return MethodChoice(
        asked="auto", method=option.method, reason=reason, options=tuple(options)
    )
