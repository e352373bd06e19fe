"""Error budget of an insertion: fit, rows, probability."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

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
from microplan.planner.budget.drift_since_look import drift_rows
from microplan.planner.budget.insert_angle import insert_angle, insert_lever_um
from microplan.planner.budget.insertion import Insertion, LateralResidual
from microplan.planner.budget.offenders import (
    ANGLE_TERM,
    WIDEN_HOLE,
    Sizes,
    changes,
    offenders,
    sizes_of,
    yield_over_shaft,
    yield_over_tolerance,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.planner.task.task import Task
from microplan.schemas.page.figures import chance
from microplan.schemas.plan import Budget, BudgetRow
from microplan.schemas.plan.verdicts import BudgetAnalysis, YieldCurve


def insertion_of(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    left: LateralResidual,
    seen: Mapping[str, PastMeasurement],
) -> Insertion | None:
    """Return the insertion that starts from the lateral residual `left`.

    `seen` are the last looks by owner. None if hole or post is unclear.
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
    blind += drift_rows(task, states, insert, (hole, shaft))
    offset_um, offset_rad = apart(
        task, insert.after, insert.step.target or "", insert.step.onto or ""
    )
    job = Insertion(
        fit=fit,
        residual=left.residual,
        early=left.early,
        turned=left.turned,
        blind=blind,
        offset_um=offset_um,
        offset_rad=offset_rad,
    )
    if not isinstance(fit, OutlineFit):
        return job
    target = locate_place(task, insert.after, insert.step.target or "")
    job = replace(job, hole_rad=target.pose.theta_rad)
    if fit.shape.turns_freely:
        return job
    return replace(
        job,
        angle=insert_angle(insert, left.angle, seen),
        lever_um=insert_lever_um(task, states, insert),
    )


def apart(task: Task, state: State, name: str, other: str) -> tuple[float, float]:
    """Return the nominal distance, um, and direction, rad, of two positions.

    (0, 0) where it is rounding.
    """
    here, there = (locate_place(task, state, n).pose for n in (name, other))
    x_um, y_um = here.x_um - there.x_um, here.y_um - there.y_um
    off_um = math.hypot(x_um, y_um)
    return (off_um, math.atan2(y_um, x_um)) if off_um > ROUNDING_UM else (0.0, 0.0)


def insert_s(task: Task, insert: StepState) -> float:
    """Return the time of an insertion's own moves in z, s, one after the other."""
    travel = travel_of(insert)
    stated = insert.step.speed_um_per_s
    return sum(
        distance_um / (stated or axes_of(task, carrier).speed_z_um_per_s)
        for carrier, distance_um in travel.items()
    )


def travel_of(insert: StepState) -> Mapping[Carrier, float]:
    """Return the travel of stage and robot in z while inserting, um."""
    before, after = insert.before, insert.after
    return {
        "stage": abs(after.stage.z_um - before.stage.z_um),
        "robot": abs(after.robot.z_um - before.robot.z_um),
    }


SIZE_TERM = "size of hole and shaft"
OFFSET_TERM = "offset that the moves leave"


def insert_budget(
    job: Insertion,
    left: LateralResidual,
    *,
    goal: float = 0.0,
    methods: Sequence[tuple[str, float]] = (),
) -> Budget:
    """Return the budget of an insertion that starts from the residual `left`.

    `goal` is the step's share of the task's, `methods` are other methods of alignment
    with the probabilities they would give. Errors of the looks' settings are left out.
    """
    sizes = sizes_of(job, left.term, OFFSET_TERM, SIZE_TERM)
    values = {name: size for name, _, size in sizes}
    size_row = BudgetRow(
        term=SIZE_TERM,
        sigma_um=values[SIZE_TERM],
        source="profile_tolerance_um, uniform within, on the capture radius",
    )
    return analysed_budget(
        job,
        (*common_rows(job, left), size_row),
        sizes,
        goal,
        limit_um=job.fit.capture_um,
        yields=(yield_over_shaft(job), yield_over_tolerance(job)),
        methods=methods,
    )


def common_rows(job: Insertion, left: LateralResidual) -> tuple[BudgetRow, ...]:
    """Return the rows of an insertion or a placement: residual, the rest, offset."""
    offset_um, source = job.offset_um, "the task's moves"
    rows = (
        BudgetRow(term=left.term, sigma_um=job.left_um, source=left.source),
        *job.blind,
        BudgetRow(term=OFFSET_TERM, sigma_um=offset_um, source=source),
    )
    if job.angle is None:
        return rows
    said = ", ".join(
        f"{row.term} {1e3 * row.sigma_rad:.3g} mrad ({row.source})"
        for row in job.angle.rows
    )
    source = f"{1e3 * job.angle.sigma_rad:.3g} mrad x {job.reach_um:.4g} um: {said}"
    return (
        *rows,
        BudgetRow(term=ANGLE_TERM, sigma_um=job.angle_um, source=source),
    )


def analysed_budget(
    job: Insertion,
    rows: tuple[BudgetRow, ...],
    sizes: Sizes,
    goal: float,
    *,
    limit_um: float,
    yields: tuple[YieldCurve, ...],
    others: float = 1.0,
    methods: Sequence[tuple[str, float]] = (),
    widen: str = WIDEN_HOLE,
) -> Budget:
    """Return a budget with its offenders, its cheapest changes and advice.

    `others` is the probability of all that must succeed besides; `widen` is as in
    `microplan.planner.budget.offenders.changes`.
    """
    needed = min(goal / others, 1.0) if others > 0 else 1.0
    miss, rest = job.miss, job.rest
    worst = offenders(job, sizes, needed)
    analysis = BudgetAnalysis(
        required_probability=goal,
        offenders=worst,
        changes=changes(job, worst, needed, methods, widen=widen),
        allowed=(),
        yields=yields,
        miss_probability=miss,
        covariance_um2=(rest.xx_um2, rest.xy_um2, rest.yy_um2),
    )
    success = (1 - miss) * others
    return Budget(
        rows=rows,
        limit_um=limit_um,
        success_probability=success,
        advice="" if success >= goal else advice_of(analysis),
        analysis=analysis,
    )


def advice_of(found: BudgetAnalysis) -> str:
    """Return the cheapest change, or what the worst term would give halved."""
    words = []
    if found.changes:
        words.append(found.changes[0].what)
    if found.offenders:
        worst = found.offenders[0]
        words.append(
            f"halving '{worst.term}' ({worst.size_um:.3g} um) would give "
            f"P {chance(worst.halved_probability)}"
        )
    return "; ".join(words) or "no single change would do"


def share_of_goal(task: Task) -> float:
    """Return the required probability of every step that may miss.

    The goal's root: each of n grasps, insertions and releases gets the same share of
    the failures, so that together they meet the goal. 0 without a goal.
    """
    goal = task.success_goal
    if goal is None:
        return 0.0
    count = sum(step.verb in ("grasp", "insert", "release") for step in task.steps)
    return math.pow(goal, 1 / max(count, 1))
