"""Checks of a task that need no rendering."""

from __future__ import annotations

from microplan.planner.assembly.mating import fit_verdict, fit_words, mating_of
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.views.alignments import check_tolerances
from microplan.planner.views.coarse import first_views
from microplan.planner.views.requests import requests
from microplan.schemas.plan.verdicts import FitVerdict


def check_task(task: Task, report: Report) -> str:
    """Return a summary of a task; findings go to the report."""
    states = unfold(task, report)
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
            report.error(
                "MP605",
                step.where,
                f"step {step.id!r}: {step.target} onto {step.onto} is no round hole "
                "over a post; other fits are not modelled",
                "name a feature of kind circle and a post",
            )
        elif mating.hole_um <= mating.shaft_um:
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
