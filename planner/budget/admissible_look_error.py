"""What the insertion after an alignment bears of the look before it leaves a zoom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import residual_after
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insert_budget import share_of_goal
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.insertion_problem import insertion_of
from microplan.planner.budget.offenders import largest_um
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.task import Task
from microplan.planner.views.requests import insertion_after

OTHER_ZOOM = 2.0  # any that is not the present one: every change has the same jump
HOPELESS = 1e-3  # a chance elsewhere that decides nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class AdmissibleError:
    """How far off a look may be, 2 sigma and bias, without a change of zoom."""

    admissible_um: float | None = None  # the insertion still has its share of the goal
    # the insertion is as likely as with a faultless look at any other zoom
    break_even_um: float | None = None


def bearable(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    within_um: float,
    seen: Mapping[str, PastMeasurement],
    memo: Memo = EVERY_TIME,
) -> AdmissibleError:
    """Return how far off an alignment's look may be for the insertion after it.

    Twice the largest sigma of the look, its setting that of the last look at the same
    part. Nothing if no insertion follows, nobody states a goal, or no sigma would do.
    """
    step, goal = insertion_after(states, align), share_of_goal(task)
    owner = owner_of(align.step.target or "")
    before = seen.get(owner)
    if step is None or before is None or goal <= 0 or before.sigma_um <= 0:
        return AdmissibleError()
    here = next(s for s in states if s.step is step)
    look = replace(before, step=align.step.id, steady_um=None)
    left = residual_after(task, align, "servo", within_um, before)

    def job(look: PastMeasurement) -> Insertion | None:
        return insertion_of(task, states, here, left, {**seen, owner: look})

    far = replace(look, magnification=OTHER_ZOOM * look.magnification)
    stays, leaves = job(look), job(far)
    if stays is None or leaves is None or look.term not in stays.sizes_um:
        return AdmissibleError()
    elsewhere = 1 - leaves.scaled(look.term, 0.0).miss

    def twice(chance: float) -> float | None:
        largest = memo.call(largest_um, stays, look.term, look.sigma_um, chance)
        return None if largest is None else 2 * largest

    return AdmissibleError(
        admissible_um=twice(goal),
        break_even_um=twice(elsewhere) if HOPELESS < elsewhere < goal else None,
    )
