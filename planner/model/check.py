"""Everything that can be said of a task without rendering."""

from __future__ import annotations

from planner.diagnostics import Report
from planner.inputs.task import Task
from planner.model.requests import Request, requests
from planner.model.scenes import shade_of
from planner.model.sightings import needed_shape, spot_of, views
from planner.model.steps import StepState, unfold

# Part of a target's edges that may be covered before a look is called into question.
HIDDEN_SHARE = 0.5


def check_task(task: Task, report: Report) -> str:
    """Return a summary of a task; findings go to the report."""
    states = unfold(task, report)
    if report.failed:
        return ""
    check_fits(task, states, report)
    looks = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    for look in looks:
        check_look(task, look, report)
    parts = ", ".join(sorted(task.parts))
    return f"{task.name}: {len(states)} steps, {len(looks)} looks, parts {parts}"


def check_look(task: Task, look: Request, report: Report) -> None:
    """Report a target that no setting shows, or that others cover or shade."""
    low, _ = task.workcell.optics.magnification
    settings = views(task, look, low, report)
    if not settings:
        return
    scope = settings[0].microscope
    shape = needed_shape(task, look)
    spot = spot_of(task, look, shape)
    shades = shade_of(task, look.state, shape, spot, scope.aperture, scope.medium_index)
    for shade in shades:
        text = (
            f"look {look.id!r}: {shade.by} hides {shade.hidden:.0%} and shades "
            f"{shade.shaded:.0%} of the edges of {shade.target}"
        )
        if shade.hidden > HIDDEN_SHARE:
            report.warning("MP306", look.where, text, "look from where it is clear")
        else:
            report.note("MP306", look.where, text)


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
