"""Checks of a task that need no rendering."""

from __future__ import annotations

import math

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.fits.mates import mates_of
from microplan.planner.assembly.fits.room import angle_elsewhere_rad
from microplan.planner.assembly.mating import (
    Mating,
    fit_verdict,
    fit_words,
    hole_and_shaft,
    mating_of,
)
from microplan.planner.assembly.step_states import StepState
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.views.alignments import check_tolerances
from microplan.planner.views.coarse import first_views
from microplan.planner.views.fit_angles import alignment_of, unfold_with_angles
from microplan.planner.views.requests import requests
from microplan.schemas.plan.verdicts import FitVerdict


def check_task(task: Task, report: Report) -> str:
    """Return a summary of a task; findings go to the report."""
    task, states = unfold_with_angles(task, report)
    if report.failed:
        return ""
    check_fits(task, states, report)
    check_tolerances(task, states, report)
    looks = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    low, _ = task.workcell.optics.magnification
    for look in looks:
        first_views(task, look, low, report)
    parts = ", ".join(sorted(task.parts))
    steps = "1 step" if len(states) == 1 else f"{len(states)} steps"
    seen = "1 look" if len(looks) == 1 else f"{len(looks)} looks"
    return f"{task.name}: {steps}, {seen}, parts {parts}"


def check_fits(task: Task, states: tuple[StepState, ...], report: Report) -> None:
    """Report how the shafts of all insertions go into their holes."""
    for state in states:
        step = state.step
        if step.verb != "insert":
            continue
        mating = mating_of(task, step, state.after)
        if mating is None:
            _report_no_fit(task, step, report)
        elif mating.shape is not None and not _is_too_thick(mating):
            _report_outlines(task, step, mating, report)
            if not mating.shape.turns_freely and alignment_of(states, state) is None:
                _report_angle(step, report)
        elif _is_too_thick(mating):
            report.refuse(
                "MP601",
                step.where,
                f"step {step.id!r}: {step.onto} is {mating.shaft_um:.4g} um thick, "
                f"{step.target} is {mating.hole_um:.4g} um wide",
                "widen the hole or thin the shaft",
            )
        else:
            found = fit_verdict(mating, task.workcell.stage.axis_tilt_sigma_rad)
            _report_fit(step, found, report)


def _is_too_thick(mating: Mating) -> bool:
    """Return whether circles alone say that a shaft does not go in."""
    freely = mating.shape is None or mating.shape.turns_freely
    return freely and mating.hole_um <= mating.shaft_um


def _report_no_fit(task: Task, step: TaskStep, report: Report) -> None:
    """Report an insertion without a hole or a post, or with several."""
    feature, post = hole_and_shaft(task, step)
    words = f"step {step.id!r}: {step.target} onto {step.onto}"
    if feature is not None and post is not None:
        mates = mates_of(task.parts[owner_of(step.target or "")], feature, post)
        if mates.unclear:
            message = f"{words} is ambiguous: {mates.unclear}"
            hint = "put the ring that mates on a layer of its own, and name that"
            report.error("MP619", step.where, message, hint)
            return
    report.error(
        "MP605",
        step.where,
        f"{words} is no hole over a post",
        "name a feature that is a hole's ring (of kind circle, or of kind outline on "
        "the hole's layer) and a post",
    )


def _report_outlines(
    task: Task, step: TaskStep, mating: Mating, report: Report
) -> None:
    """Report the fit of outlines that are not both circles."""
    found = fit_verdict(mating, task.workcell.stage.axis_tilt_sigma_rad)
    if mating.shape is None or found.outline is None:
        raise ValueError("a fit of outlines has them")
    if found.capture_um[1] > 0:
        _report_fit(step, found, report)
        return
    least = found.clearance_um[1]
    words = f"step {step.id!r}: {step.onto} does not go into {step.target} as planned: "
    words += f"it is {found.outline.overlap_um:.3g} um deep in the material around it"
    if least > 0:
        hint = "move one of them, or its origin: at another place it goes in"
    else:
        words += f", and {-least:.3g} um too wide at any place"
        turn = angle_elsewhere_rad(mating.shape)
        hint = "widen the hole or thin the shaft: it goes in at no angle"
        if turn is not None:
            hint = f"turned by {math.degrees(turn):.4g} deg it goes in"
    report.refuse("MP617", step.where, words, hint)


def _report_angle(step: TaskStep, report: Report) -> None:
    """Report an insertion whose angle nothing aligns."""
    report.warning(
        "MP618",
        step.where,
        f"step {step.id!r}: {step.onto} goes into {step.target} at some angles only, "
        "and no alignment of both comes before it: P counts their angles as they start",
        "add a step 'do: align' of both before it, after which nothing moves sideways",
    )


def _report_fit(step: TaskStep, found: FitVerdict, report: Report) -> None:
    """Report a fit with its numbers, louder where some parts will not go."""
    words = fit_words(step.id, found)
    if found.engaged_um <= 0:
        hint = "end the moves where the hole is around the shaft"
        report.refuse("MP610", step.where, words, hint)
    elif found.fit == "clearance":
        hint = "any two parts within tolerance go together"
        report.fact("MP610", step.where, words, hint)
    else:
        hint = "widen the hole or thin the shaft, or make both closer to their drawings"
        report.warning("MP610", step.where, words, hint)
    if found.may_wedge and found.wedging_rad is not None:
        report.warning(
            "MP611",
            step.where,
            f"step {step.id!r}: axes that lean {1e3 * found.tilt_rad:.3g} mrad at 3 "
            f"sigma may wedge the shaft, which needs {1e3 * found.wedging_rad:.3g} mrad"
            f" while it is less than {found.wedging_depth_um:.3g} um deep",
            "square the axes, widen the hole, or lower the friction",
        )
