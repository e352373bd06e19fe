"""Collision probability of a step's declared moves from the sigma of every gap.

MP303 refuses a gap of less than two sigma. What is left above that is small, and no
sensor of the cell may detect it, so that it belongs into the probability of success.
"""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.planner.assembly.assembly import Carrier, State, owner_of
from microplan.planner.assembly.step_states import StepState, apply_reading
from microplan.planner.assembly.swept_volume import SURFACE, Hit, sweep_gaps
from microplan.planner.task.task import Task
from microplan.schemas.plan import Budget, BudgetRow

NEGLIGIBLE = 1e-12  # a probability of touching that no row reports


def with_collisions(task: Task, here: StepState, budget: Budget) -> Budget:
    """Return a step's budget, with the collision probability of its moves.

    The narrowest gap is a row where the step has no other: rows of a grasp, an
    insertion or a placement are sigmas of a position.
    """
    gaps = narrow_gaps(task, here)
    if not gaps:
        return budget
    chance = budget.success_probability * math.prod(1 - gap.chance for gap in gaps)
    if budget.rows or budget.limit_um is not None:
        return replace(budget, success_probability=chance)
    worst = max(gaps, key=lambda gap: gap.chance)
    row = BudgetRow(
        term=f"gap between {worst.moving} and {worst.still}",
        sigma_um=worst.sigma_um,
        source=f"{worst.gap_um:.4g} um apart at the nominal place, on the moves' way",
    )
    return replace(
        budget, rows=(row,), limit_um=worst.gap_um, success_probability=chance
    )


def narrow_gaps(task: Task, here: StepState) -> tuple[Hit, ...]:
    """Return the gaps of a step's declared moves that may close, least of each pair.

    An insertion's own moves touch what they shall, and are counted in its budget.
    """
    state, least = here.before, dict[tuple[str, str], Hit]()
    for move in here.moves:
        after = apply_reading(task, state, move.axes, move.to)
        for gap in _gaps(task, state, after, move.axes):
            # what the robot carries comes down upon the stage as one
            one = owner_of(gap.moving) if gap.still == SURFACE else gap.moving
            pair = (one, gap.still)
            if pair not in least or gap.chance > least[pair].chance:
                least[pair] = gap
        state = after
    return tuple(least[pair] for pair in sorted(least))


def _gaps(task: Task, before: State, after: State, carrier: Carrier) -> tuple[Hit, ...]:
    """Return the gaps of one move whose probability is not negligible."""
    gaps = sweep_gaps(task, before, after, carrier=carrier)
    return tuple(gap for gap in gaps if gap.chance > NEGLIGIBLE)
