"""Error budget of a placement from looks, moves, angles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from microplan.arrays import Point
from microplan.planner.assembly.assembly import Carrier, axes_of, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.swept_volume import ROUNDING_UM
from microplan.planner.budget.alignment_residual import (
    residual_after,
    unaligned,
)
from microplan.planner.budget.allowable_errors import with_allowable_errors
from microplan.planner.budget.budget import PastMeasurement, blind_rows
from microplan.planner.budget.drift_since_look import drift_rows
from microplan.planner.budget.insert_budget import apart, share_of_goal
from microplan.planner.budget.insertion import Insertion, LateralResidual
from microplan.planner.budget.measurement_history import (
    MeasurementHistory,
    method_taken,
)
from microplan.planner.budget.placement import (
    PlacementContext,
    far_um,
    lever_um,
    moves_s,
    placement_context,
)
from microplan.planner.budget.placing import (
    Placement,
    other_success,
    placing_budget,
    within,
)
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import moved_by, settled_theta_rad
from microplan.schemas.plan import Budget, BudgetRow
from microplan.schemas.plan.verdicts import PlacingVerdict, TurnRow

LEVER = "angle of {} over the way to what is placed"
TURNED = "turn that the alignment leaves"


def place_budget(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    history: MeasurementHistory,
    context: CompileContext,
) -> tuple[Budget, PlacingVerdict] | None:
    """Return the budget of a placement, None if no tolerance is specified.

    A part on a shaft is the insertion's.
    """
    put = placement_context(task, states, here, history)
    if put is None:
        return None
    placed, left, goal = _placement(put), placement_residual(put), share_of_goal(task)
    angle, job = angle_error(put), placement_errors(put, left)
    budget, verdict = context.memo.call(
        placing_budget, placed, job, left, angle, goal=goal
    )
    others = other_success(placed, angle)
    needed = goal / others if others > 0 else 1.0
    if put.align is None:
        return budget, verdict
    pair = (put.part, put.seat)
    return (
        with_allowable_errors(budget, task, job, needed, history, pair, context),
        verdict,
    )


def placement_residual(put: PlacementContext) -> LateralResidual:
    """Return the lateral residual of the alignment before a release."""
    if put.align is None:
        parts = (put.part, put.seat)
        since = "of them since the part was taken"
        return unaligned(put.release.before, parts, since)
    return residual_after(
        put.task,
        put.align,
        method_taken(put.align, put.history),
        put.history.within_um,
        put.history.before,
    )


def placement_errors(put: PlacementContext, left: LateralResidual) -> Insertion:
    """Return the lateral errors of a placement, with its tolerance as the fit."""
    names = (put.verify.target or "", put.verify.on or "")
    offset_um, offset_rad = apart(put.task, put.release.after, *names)
    return Insertion(
        fit=within(put.verify.within_um or 0.0),
        residual=left.residual,
        early=left.early,
        turned=left.turned,
        blind=(*_blind(put), *_levers(put)),
        offset_um=offset_um,
        offset_rad=offset_rad,
    )


def _placement(put: PlacementContext) -> Placement:
    """Return the placement of a release, with its tolerances."""
    target, tool = put.verify.target or "", put.release.before.tool
    tools = put.task.workcell.tools
    return Placement(
        target=target,
        on=put.verify.on or "",
        verified_by=put.verify.id,
        within_um=put.verify.within_um or 0.0,
        within_rad=put.verify.within_rad,
        far_um=far_um(put.task.parts[put.part], target),
        stick_probability=0.0 if tool is None else tools[tool].stick_probability,
    )


def angle_error(put: PlacementContext) -> AngleError:
    """Return the error of the part's angle against its seat's."""
    task, turned, state = put.task, put.turned, put.release.before
    spread = [state.parts[name].sigma_theta_rad for name in (put.part, put.seat)]
    since = list(_since_turns(put))
    if turned is None:
        left = math.hypot(*spread, task.workcell.stage.axes.repeatability_theta_rad)
        return AngleError(left_rad=left, cut_rad=math.inf, rows=tuple(since))
    settled = settled_theta_rad(task, moved_by(task, turned))
    rows = [
        TurnRow(
            term=f"angle of {name if seen is None else seen.name}",
            sigma_rad=_angle_rad(seen, wide),
            source="trials"
            if seen is not None
            else "not measured: its spread in the task",
        )
        for name, seen, wide in zip(
            (put.part, put.seat), put.angles_seen, spread, strict=True
        )
    ]
    # what is remembered of an alignment is of the last one
    last, choice = turned is put.align, put.history.choice
    method = choice.method if last and choice is not None else turned.step.method
    if method == "look_then_move":
        left, cut = settled, math.inf
    else:
        known = spread[owner_of(turned.step.target or "") == put.seat]
        before = put.history.before if last else None
        left = math.hypot(_angle_rad(before, known), settled)  # as the approach has it
        cut = turned.step.tolerance_theta_rad or math.inf
    return AngleError(left_rad=left, cut_rad=cut, rows=(*rows, *since))


def _angle_rad(seen: PastMeasurement | None, spread_rad: float) -> float:
    """Return how well an angle is known: by the look, else as the task has it."""
    if seen is None or seen.sigma_theta_rad is None:
        return spread_rad
    return seen.sigma_theta_rad


def _blind(put: PlacementContext) -> Iterator[BudgetRow]:
    """Yield the terms of the position that the alignment cannot see."""
    task, release = put.task, put.release.before
    start = release if put.align is None else put.align.after
    first = put.since_seen[0].before if put.since_seen else release
    travel: dict[Carrier, float] = {
        "stage": abs(release.stage.z_um - start.stage.z_um),
        "robot": abs(release.robot.z_um - first.robot.z_um),
    }
    seen = put.seen if put.align is not None else (None, None)
    takes_s = moves_s(task, put.since_align)
    yield from blind_rows(task.workcell, travel, *seen, takes_s, doing="placing")
    names = (put.verify.target or "", put.verify.on or "")
    yield from drift_rows(task, put.states, put.release, seen, names)


def _since_turns(put: PlacementContext) -> Iterator[TurnRow]:
    """Yield the errors that rotations of the axes add after the looks."""
    stage = put.since_align if put.turned is None else put.since_turned
    since: dict[Carrier, Sequence[StepState]] = {
        "stage": stage,
        "robot": put.since_seen,
    }
    for carrier, steps in since.items():
        moves = [move for here in steps for move in here.moves if move.axes == carrier]
        if any(move.to.theta_rad is not None for move in moves):
            repeats = axes_of(put.task, carrier).repeatability_theta_rad
            yield TurnRow(
                term=f"{carrier} turns since it was measured",
                sigma_rad=math.sqrt(2) * repeats,
                source="workcell repeatability_theta_arcsec, of two places",
            )


def _levers(put: PlacementContext) -> Iterator[BudgetRow]:
    """Yield the displacements by errors of angles."""
    if put.align is None:
        return
    state = put.release.before
    points = (put.verify.target, put.verify.on)
    for name, seen, angle, point in zip(
        (put.part, put.seat), put.seen, put.angles_seen, points, strict=True
    ):
        if seen is None:
            continue
        sigma = _angle_rad(angle, state.parts[name].sigma_theta_rad)
        way = lever_um(put, name, seen.name, point or "")
        yield from _lever(LEVER.format(seen.name), sigma, way)
    aligned = next(
        n
        for n in (put.align.step.target, put.align.step.to)
        if owner_of(n or "") == put.part
    )
    way = lever_um(put, put.part, aligned or "", put.verify.target or "")
    yield from _lever(TURNED, replace(angle_error(put), rows=()).sigma_rad, way)


def _lever(term: str, sigma_rad: float, way: Point) -> Iterator[BudgetRow]:
    """Yield the displacement by an angle at the end of a lever, if it is long."""
    arm_um = math.hypot(*way)
    if arm_um > ROUNDING_UM:
        yield BudgetRow(
            term=term,
            sigma_um=min(sigma_rad, 1.0) * arm_um,
            source=f"{min(sigma_rad, 1.0) * 1e3:.3g} mrad x {arm_um:.4g} um",
            along_rad=math.atan2(way[1], way[0]) + math.pi / 2,
        )
