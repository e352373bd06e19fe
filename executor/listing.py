"""A plan in words: every move, look and action of every step."""

from __future__ import annotations

from typing import Any

from schemas.codec import to_data
from schemas.plan import Measure, Plan, Step


def plan_lines(plan: Plan) -> list[str]:
    """Return one line for every move, look and action of the plan."""
    return [line for step in plan.steps for line in step_lines(step)]


def step_lines(step: Step) -> list[str]:
    """Return the lines of one step."""
    lines = [f"{step.id}: {step.verb}"]
    lines += [f"  move {_targets(to_data(move))}" for move in step.moves]
    lines += [
        f"  look at {look.target} at {look.view.magnification:g} x, focus "
        f"{look.view.focus_um:g} um: {'; '.join(map(_found_by, look.measures))}"
        for look in step.looks
    ]
    return lines


def _found_by(measure: Measure) -> str:
    """Return the routines that find a feature, and which, if it is not the target."""
    names = ", ".join(use.id for use in measure.chain)
    return f"{names} on {measure.feature}" if measure.feature else names


def _targets(move: dict[str, Any]) -> str:
    """Return the axes a move names, with their values."""
    axes = move.pop("axes")
    return " ".join(f"{axes}.{k}={v:g}" for k, v in move.items() if v is not None)
