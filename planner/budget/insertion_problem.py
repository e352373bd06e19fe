"""An insertion put together: its fit, what the servo leaves, what no look can see."""

from __future__ import annotations

import math
from collections.abc import Mapping

from microplan.planner.assembly.assembly import (
    Carrier,
    State,
    axes_of,
    locate_place,
    owner_of,
)
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.swept_volume import ROUNDING_UM
from microplan.planner.budget.budget import PastMeasurement, blind_rows, fit_of
from microplan.planner.budget.drift_since_look import since_rows
from microplan.planner.budget.insert_budget import LateralResidual
from microplan.planner.budget.insertion import Insertion
from microplan.planner.task.task import Task


def insertion_of(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    left: LateralResidual,
    seen: Mapping[str, PastMeasurement],
) -> Insertion | None:
    """Return the insertion that starts from what is `left` sideways.

    `seen` are the last looks by owner. None if hole or shaft is not round.
    """
    fit = fit_of(task, insert)
    if fit is None:
        return None
    hole, shaft = (
        seen.get(owner_of(name or ""))
        for name in (insert.step.target, insert.step.onto)
    )
    cell = task.workcell
    blind = blind_rows(cell, travel_of(insert), hole, shaft, insert_s(task, insert))
    blind += since_rows(task, states, insert, (hole, shaft))
    offset_um, offset_rad = apart(
        task, insert.after, insert.step.target or "", insert.step.onto or ""
    )
    return Insertion(
        fit=fit,
        residual=left.residual,
        early=left.early,
        blind=blind,
        offset_um=offset_um,
        offset_rad=offset_rad,
    )


def apart(task: Task, state: State, name: str, other: str) -> tuple[float, float]:
    """Return how far, um, and in which direction, rad, places are nominally apart.

    (0, 0) where it is rounding.
    """
    here, there = (locate_place(task, state, n).pose for n in (name, other))
    x_um, y_um = here.x_um - there.x_um, here.y_um - there.y_um
    off_um = math.hypot(x_um, y_um)
    return (off_um, math.atan2(y_um, x_um)) if off_um > ROUNDING_UM else (0.0, 0.0)


def insert_s(task: Task, insert: StepState) -> float:
    """Return how long an insertion's own moves take in z, one after the other."""
    travel = travel_of(insert)
    stated = insert.step.speed_um_per_s
    return sum(
        way_um / (stated or axes_of(task, carrier).speed_z_um_per_s)
        for carrier, way_um in travel.items()
    )


def travel_of(insert: StepState) -> Mapping[Carrier, float]:
    """Return how far stage and robot travel in z while inserting, um."""
    before, after = insert.before, insert.after
    return {
        "stage": abs(after.stage.z_um - before.stage.z_um),
        "robot": abs(after.robot.z_um - before.robot.z_um),
    }
