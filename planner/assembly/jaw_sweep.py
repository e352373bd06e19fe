"""Jaws that close or open: what the fingers sweep over, and would touch."""

from __future__ import annotations

from dataclasses import replace

from microplan.planner.assembly.assembly import State, owner_of
from microplan.planner.assembly.swept_volume import SURFACE, Hit, sweep_hits
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep


def jaw_hits(
    task: Task, state: State, opening_um: float, between: str
) -> tuple[Hit, ...]:
    """Return what the fingers hit on their way to another opening.

    The part `between` them is meant to be touched; the stage's surface is as far below
    as it was.
    """
    after = replace(state, opening_um=opening_um)
    hits = sweep_hits(task, state, after, carrier="robot")
    return tuple(
        hit
        for hit in hits
        if owner_of(hit.moving) == state.tool
        and hit.still != SURFACE
        and owner_of(hit.still) != between
    )


def report_jaws(
    task: Task, state: State, step: TaskStep, opening_um: float, report: Report
) -> None:
    """Report what the fingers would touch while they close or open."""
    between = owner_of(step.target or "")
    for hit in jaw_hits(task, state, opening_um, between):
        report.refuse(
            "MP303",
            step.spans.get("opening_um", step.where),
            f"step {step.id!r}: {hit.moving}, on its way from {state.opening_um:g} to "
            f"{opening_um:g} um, would touch {hit.still}: {hit.gap_um:.3g} um apart at "
            f"the nominal place, {hit.needed_um:.3g} um needed at 2 sigma",
            "another opening, or another place",
        )
