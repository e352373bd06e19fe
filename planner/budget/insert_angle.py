"""Error of the angle at an insertion, and what it moves sideways."""

from __future__ import annotations

import math
from collections.abc import Mapping

from microplan.planner.assembly.assembly import locate_place, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.swept_volume import ROUNDING_UM
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insertion import AngleLeft
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.task.task import Task
from microplan.planner.views.fit_angles import alignment_of
from microplan.schemas.plan.verdicts import TurnRow


def insert_angle(
    insert: StepState, left: AngleLeft | None, seen: Mapping[str, PastMeasurement]
) -> AngleError:
    """Return the error of a shaft's angle in its hole.

    After an alignment that turns, what that leaves and how well its looks know both
    angles; without one the angles of both parts as the task has them.
    """
    names = [owner_of(n or "") for n in (insert.step.target, insert.step.onto)]
    spread = [insert.before.parts[name].sigma_theta_rad for name in names]
    if left is None:
        rows = tuple(
            TurnRow(
                term=f"angle of {name}",
                sigma_rad=sigma,
                source="not aligned: its spread in the task",
            )
            for name, sigma in zip(names, spread, strict=True)
        )
        return AngleError(left_rad=0.0, cut_rad=math.inf, rows=rows)
    rows = tuple(
        _measured(name, seen.get(name), sigma)
        for name, sigma in zip(names, spread, strict=True)
    )
    return AngleError(left_rad=left.sigma_rad, cut_rad=left.within_rad, rows=rows)


def _measured(name: str, seen: PastMeasurement | None, spread_rad: float) -> TurnRow:
    """Return how well the angle of a part is known."""
    known = None if seen is None else seen.sigma_theta_rad
    if seen is None or known is None:
        source = "not measured: its spread in the task"
        return TurnRow(term=f"angle of {name}", sigma_rad=spread_rad, source=source)
    return TurnRow(term=f"angle of {seen.name}", sigma_rad=known, source="trials")


def insert_lever_um(
    task: Task, states: tuple[StepState, ...], insert: StepState
) -> tuple[float, float]:
    """Return what an error of the shaft's angle moves the hole by, um per rad.

    The alignment holds its own points together; hole and shaft are where they are
    about those. (0, 0) if they are the same points.
    """
    align = alignment_of(states, insert)
    if align is None:
        return (0.0, 0.0)
    state, x_um, y_um = insert.after, 0.0, 0.0
    for name in (insert.step.target or "", insert.step.onto or ""):
        names = (align.step.target or "", align.step.to or "")
        aligned = next(n for n in names if owner_of(n) == owner_of(name))
        here, there = (locate_place(task, state, n).pose for n in (name, aligned))
        x_um, y_um = x_um + here.x_um - there.x_um, y_um + here.y_um - there.y_um
    if math.hypot(x_um, y_um) <= ROUNDING_UM:
        return (0.0, 0.0)
    return (y_um, -x_um)
