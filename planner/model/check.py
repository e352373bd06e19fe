"""Everything that can be said of a task without rendering."""

from __future__ import annotations

from planner.diagnostics import Report
from planner.inputs.task import Task
from planner.model.requests import requests
from planner.model.sightings import views
from planner.model.steps import StepState, unfold


def check_task(task: Task, report: Report) -> str:
    """Return a summary of a task; findings go to the report."""
    states = unfold(task, report)
    if report.failed:
        return ""
    check_fits(task, states, report)
    looks = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    low, _ = task.workcell.optics.magnification
    for look in looks:
        views(task, look, low, report)
    parts = ", ".join(sorted(task.parts))
    return f"{task.name}: {len(states)} steps, {len(looks)} looks, parts {parts}"


def check_fits(task: Task, states: tuple[StepState, ...], report: Report) -> None:
    """Report insertions whose shaft does not go into the hole, sizes as drawn."""
    for state in states:
        step = state.step
        if step.verb != "insert":
            continue
        hole_part, _, hole = (step.target or "").partition(".")
        shaft_part, _, shaft = (step.onto or "").partition(".")
        feature = task.parts[hole_part].features.get(hole)
        post = task.parts[shaft_part].posts.get(shaft)
        if feature is None or post is None or feature.kind != "circle":
            report.error(
                "MP605",
                step.where,
                f"step {step.id!r}: {step.target} onto {step.onto} is no round hole "
                "over a post; other fits are not modelled",
                "name a feature of kind circle and a post",
            )
        elif feature.radius_um <= post.radius_um:
            report.refuse(
                "MP601",
                step.where,
                f"step {step.id!r}: {step.onto} is {2 * post.radius_um:.4g} um thick, "
                f"{step.target} is {2 * feature.radius_um:.4g} um wide",
                "widen the hole or thin the shaft",
            )
