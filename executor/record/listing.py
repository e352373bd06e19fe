"""Listing of a plan in words: moves, looks, actions of every step."""

from __future__ import annotations

from typing import Any

from microplan.schemas.codec import to_data
from microplan.schemas.files.times import probes
from microplan.schemas.plan import (
    AlignAction,
    GraspAction,
    InsertAction,
    Measure,
    Plan,
    ReleaseAction,
    Step,
    VerifyAction,
)


def plan_lines(plan: Plan) -> list[str]:
    """Return one line for every move, look and action of the plan."""
    return [line for step in plan.steps for line in step_lines(plan, step)]


def step_lines(plan: Plan, step: Step) -> list[str]:
    """Return the lines of one step of a plan."""
    lines = [f"{step.id}: {step.verb}"]
    lines += [f"  move {_targets(to_data(move))}" for move in step.moves]
    lines += [
        f"  look at {look.target} at {look.view.magnification:g} x, focus "
        f"{look.view.focus_um:g} um: {'; '.join(map(_found_by, look.measures))}"
        for look in step.looks
    ]
    if probes(plan, step):
        lines.append(
            "  probe: the axes that carry it move up to 100 um to all sides, and back, "
            "with a look after each move"
        )
    words = action_line(step)
    return [*lines, f"  {words}"] if words else lines


def action_line(step: Step) -> str:
    """Return a step's action in words, "" if it only looks or moves."""
    words = _action(step)
    return f"{words} (cannot be undone)" if step.irreversible else words


def _action(step: Step) -> str:
    """Return a step's action in words."""
    action, control = step.action, step.control
    match action:
        case AlignAction():
            until = "" if control is None else (
                f", looking after each move, to {control.tolerance_xy_um:.3g} um"
            )  # fmt: skip
            return f"align {action.target} to {action.to} by the {action.axes}{until}"
        case GraspAction():
            return f"close {action.tool} to {action.opening_um:g} um on {action.target}"
        case InsertAction():
            moves = "; ".join(_targets(to_data(move)) for move in action.moves)
            return f"put {action.target} onto {action.onto}: {moves}"
        case ReleaseAction():
            return f"open {action.tool} to {action.opening_um:g} um: {action.target}"
        case VerifyAction():
            sweep = "" if action.height is None else (
                f"; for its height the focus goes from {min(action.height.focus_um):g} "
                f"to {max(action.height.focus_um):g} um"
            )  # fmt: skip
            return f"verify that {action.target} sits on {action.on}{sweep}"
    return ""


def _found_by(measure: Measure) -> str:
    """Return the routines that find a feature, and which, if it is not the target."""
    names = ", ".join(use.id for use in measure.chain)
    return f"{names} on {measure.feature}" if measure.feature else names


def _targets(move: dict[str, Any]) -> str:
    """Return the axes a move names, with their values."""
    axes = move.pop("axes")
    return " ".join(f"{axes}.{k}={v:g}" for k, v in move.items() if v is not None)
