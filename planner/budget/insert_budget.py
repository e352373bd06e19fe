"""The budget of an insertion: its rows, its chance, and what they hang on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.offenders import (
    changes,
    offenders,
    sizes_of,
    yield_over_shaft,
    yield_over_tolerance,
)
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.task.task import Task
from microplan.schemas.page.figures import chance
from microplan.schemas.plan import Budget, BudgetRow
from microplan.schemas.plan.verdicts import BudgetAnalysis

SIZE_TERM = "size of hole and shaft"
OFFSET_TERM = "offset that the moves leave"


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralResidual:
    """What is left sideways before an insertion, with its name in the budget."""

    residual: Residual
    term: str
    source: str
    early: tuple[float, Residual] | None = None  # as `Insertion.early`


def insert_budget(
    job: Insertion,
    left: LateralResidual,
    *,
    goal: float = 0.0,
    methods: Sequence[tuple[str, float]] = (),
) -> Budget:
    """Return the budget of an insertion that starts from what is `left`.

    `goal` is the step's share of the task's, `methods` are other ways to align with
    the chances they would give. What the looks' settings bear is left open.
    """
    sizes = sizes_of(job, left.term, OFFSET_TERM, SIZE_TERM)
    values = {name: size for name, _, size in sizes}
    rows = (
        BudgetRow(term=left.term, sigma_um=values[left.term], source=left.source),
        *job.blind,
        BudgetRow(
            term=OFFSET_TERM,
            sigma_um=job.offset_um,
            source="the task's moves",
        ),
        BudgetRow(
            term=SIZE_TERM,
            sigma_um=values[SIZE_TERM],
            source="profile_tolerance_um, uniform within, on the capture radius",
        ),
    )
    chance, rest = 1 - job.miss, job.rest
    worst = offenders(job, sizes, goal)
    cheap = changes(job, worst, goal, methods)
    analysis = BudgetAnalysis(
        required_probability=goal,
        offenders=worst,
        changes=cheap,
        allowed=(),
        yields=(yield_over_shaft(job), yield_over_tolerance(job)),
        miss_probability=job.miss,
        covariance_um2=(rest.xx_um2, rest.xy_um2, rest.yy_um2),
    )
    advice = "" if chance >= goal else advice_of(analysis)
    return Budget(
        rows=rows,
        limit_um=job.fit.capture_um,
        success_probability=chance,
        advice=advice,
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
    """Return the chance that every step which may miss must reach.

    The goal's root: each of n grasps, insertions and releases gets the same share of
    the failures, so that together they meet the goal. 0 without a goal.
    """
    goal = task.success_goal
    if goal is None:
        return 0.0
    count = sum(step.verb in ("grasp", "insert", "release") for step in task.steps)
    return math.pow(goal, 1 / max(count, 1))
