"""Findings on task inputs without effect, or starts without a standard deviation."""

from __future__ import annotations

from microplan.planner.assembly.assembly import State, locate_place
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep


def report_faces(task: Task, report: Report) -> None:
    """Refuse parts that lie face down: the plan would be of parts lying face up."""
    for start in task.part_starts.values():
        if start.face == "down":
            report.refuse(
                "MP307",
                start.where,
                f"'face: down' has no effect: drawings are not turned over, so "
                f"{start.name} would be planned as if it lay face up",
                "draw the part as it lies, posts up, and leave 'face' out",
            )


def report_unused_input(
    task: Task, state: State, step: TaskStep, report: Report
) -> None:
    """Report keys of a step that change nothing in the `state` before it."""
    why = _idle_view(task, state, step)
    if why:
        report.warning(
            "MP307",
            step.spans.get("view_um", step.where),
            f"step {step.id!r}: 'view_um' has no effect: {why[0]}",
            why[1],
        )
    if step.if_blocked:
        report.note(
            "MP307",
            step.spans.get("if_blocked", step.where),
            f"step {step.id!r}: 'if_blocked' has no effect: the executor does not "
            "sense a blocked insertion, and searches nothing",
            "a later 'verify' with 'height_within_um' finds what did not go in",
        )


def _idle_view(task: Task, state: State, step: TaskStep) -> tuple[str, str] | None:
    """Return why `view_um` moves nothing and what to do; None if it moves."""
    if step.view_um is None:
        return None
    if step.verb == "insert":
        return (
            "an insertion takes no look, and moving the stage would undo the alignment",
            "leave it out, or give it to the alignment before",
        )
    if step.target is None:
        return (
            "the step has no target to bring there",
            "state the stage's reading in 'move'",
        )
    if locate_place(task, state, step.target).carrier != "stage":
        return (
            f"it moves the stage, and {step.target} is on the robot",
            "leave it out, or move the robot in 'move'",
        )
    return None


def report_certain_starts(task: Task, report: Report) -> None:
    """Note parts whose start position or angle has no standard deviation."""
    for start in task.part_starts.values():
        known = [
            words
            for words, sigma in (
                ("place", start.sigma_xy_um),
                ("angle", 1.0 if start.theta_any else start.sigma_theta_rad),
            )
            if sigma == 0
        ]
        if known:
            report.note(
                "MP309",
                start.where,
                f"{start.name} starts without a spread of its {' and '.join(known)}: "
                "looks and budgets take it as exactly known",
                "state sigma_xy_um and sigma_theta_deg, one standard deviation each",
            )
