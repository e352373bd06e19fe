"""Drift since the last look at a part, as error of an insertion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.tolerance_search import Setting
from microplan.planner.assembly.assembly import (
    Carrier,
    Place,
    State,
    axes_of,
    locate_place,
    owner_of,
    robot_pose,
)
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.budget import (
    FOCUS_TERM,
    MEASURED,
    PICTURES,
    PastMeasurement,
)
from microplan.planner.budget.insertion import Insertion
from microplan.planner.task.task import Task
from microplan.schemas.plan import BudgetRow


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftTolerance:
    """Test whether an insertion tolerates the measurements of a look at a drift.

    The mean error of the draws is an offset that is not corrected, in the worst
    direction; what they scatter by counts as the look's error where it is larger than
    what the trials found. It is asked of draws that are all `is_placed`.
    """

    job: Insertion
    goal: float  # probability that the insertion must keep
    term: str  # of the look's error in the budget
    setting: Setting
    bias_um: tuple[float, float]  # taken off what is measured, in the target's frame
    lateral_um: float = 0.0  # sigma per um of focus that the lens shifts by

    def __call__(self, drift: float, found: Sequence[Outcome], /) -> bool:
        """Return whether the probability is kept at `drift`."""
        places = np.array([outcome.target_um for outcome in found], dtype=np.float64)
        errors = places - np.array(self.bias_um)
        offset_um = math.hypot(*errors.mean(axis=0))
        job = self._at(drift, _scatter_um(errors))
        return 1 - job.missed_with(offset_um) >= self.goal

    def _at(self, drift: float, scatter_um: float) -> Insertion:
        """Return the insertion with the look's error, and the lens's, at a drift."""
        job, sizes = self.job, self.job.sizes_um
        # draws scatter by their pictures' discrepancy too, which has a row of its own
        true_um = sizes.get(self.term.replace(MEASURED, PICTURES, 1), 0.0)
        own_um = math.sqrt(max(scatter_um**2 - true_um**2, 0.0))
        job = job.resized(self.term, max(own_um, sizes.get(self.term, 0.0)))
        if self.setting != "focus" or FOCUS_TERM not in sizes:
            return job
        grown_um = sizes[FOCUS_TERM] + self.lateral_um * abs(drift)
        return job.resized(FOCUS_TERM, grown_um)


def is_placed(outcome: Outcome) -> bool:
    """Return whether a draw gave a position; a look without one is repeated."""
    return outcome.target_um is not None


def _scatter_um(errors_um: np.ndarray) -> float:
    """Return the scatter per axis of errors (N, 2) about their mean; 0 of one."""
    free = 2 * (len(errors_um) - 1)
    if free <= 0:
        return 0.0
    off = errors_um - errors_um.mean(axis=0)
    return math.sqrt(float((off**2).sum()) / free)


# A look measures a part with the error of the axes at that moment; what moves
# afterwards loses that error and gets another.
BEFORE_AND_AFTER = math.sqrt(2)


def drift_rows(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    seen: Sequence[PastMeasurement | None],
    names: Sequence[str] | None = None,
) -> tuple[BudgetRow, ...]:
    """Return the error rows of all moves since hole and shaft were measured.

    Parameters
    ----------
    task : Task
        The task.
    states : tuple of StepState
        All steps' states.
    insert : StepState
        The insertion.
    seen : (hole, shaft)
        The last look at each, None if there was none.
    names : sequence of str, optional
        Of what is brought together, if it is not an insertion's target and shaft.

    Returns
    -------
    tuple of BudgetRow
        None for a part whose axes stood still sideways. Turned axes swing it across
        the lever from their axis; what changed hands lies where the jaws put it.
    """
    if names is None:
        names = (insert.step.target or "", insert.step.onto or "")
    return tuple(
        row
        for name, look in zip(names, seen, strict=True)
        if look is not None
        for row in _rows(task, states, insert, name, look)
    )


def _rows(
    task: Task,
    states: tuple[StepState, ...],
    insert: StepState,
    name: str,
    look: PastMeasurement,
) -> Iterator[BudgetRow]:
    """Yield the terms of one of the two parts."""
    first = next(i for i, s in enumerate(states) if s.step.id == look.step)
    later = states[first + 1 : states.index(insert) + 1]
    place = locate_place(task, insert.before, name)
    if any(_changes_hands(s, place.owner) for s in later):
        yield BudgetRow(
            term=f"place of {place.owner} in the jaws",
            sigma_um=insert.before.parts[place.owner].sigma_xy_um,
            source=f"grasped after {look.step!r} looked",
        )
    axes, carrier = axes_of(task, place.carrier), place.carrier
    moved = [side for s in later for side in _moved(task, s, carrier)]
    if "xy" in moved:
        yield BudgetRow(
            term=f"{carrier} moved since the look at {name}",
            sigma_um=BEFORE_AND_AFTER * axes.repeatability_xy_um,
            source="workcell repeatability_xy_um before and after",
        )
    if "theta" in moved:
        yield _swing(task, insert.before, place)


def _swing(task: Task, state: State, place: Place) -> BudgetRow:
    """Return what a new error of an angle moves, across the lever."""
    x_um, y_um = _lever(task, state, place)
    lever_um = math.hypot(x_um, y_um)
    sigma_rad = axes_of(task, place.carrier).repeatability_theta_rad
    return BudgetRow(
        term=f"{place.carrier} turned since the look at {place.name}",
        sigma_um=BEFORE_AND_AFTER * sigma_rad * lever_um,
        source=f"workcell repeatability_theta_arcsec x {lever_um:.4g} um, before and "
        "after",
        along_rad=math.atan2(x_um, -y_um) if lever_um > 0 else None,
    )


def _lever(task: Task, state: State, place: Place) -> tuple[float, float]:
    """Return the lever from the axis of rotation to a position, um in the world."""
    here = place.pose
    if place.carrier == "stage":
        axis_x, axis_y = task.workcell.stage.theta_axis_um
        return (
            here.x_um - state.stage.x_um - axis_x,
            here.y_um - state.stage.y_um - axis_y,
        )
    grip = robot_pose(state.robot)  # its axis is behind the fingers, at +y
    axis_x, axis_y = grip.apply(0.0, _axis_from_grip_um(task, state))
    return (here.x_um - axis_x, here.y_um - axis_y)


def _axis_from_grip_um(task: Task, state: State) -> float:
    """Return how far the robot's theta axis is behind the grip."""
    tool = task.workcell.tools[state.tool or ""]
    return task.workcell.robot.theta_axis_to_tip_um - tool.grip_from_tip_um


def _changes_hands(step: StepState, owner: str) -> bool:
    """Return whether a step takes hold of a part."""
    return step.step.verb == "grasp" and owner_of(step.step.target or "") == owner


def _moved(task: Task, step: StepState, carrier: Carrier) -> Iterator[str]:
    """Yield "xy" and "theta" if a step moves them on what carries the part."""
    moves = step.moves if step.step.verb != "insert" else step.step.move
    for move in moves:
        if move.axes == carrier and not (move.to.x_um is move.to.y_um is None):
            yield "xy"
        if move.axes == carrier and move.to.theta_rad is not None:
            yield "theta"
    if step.step.verb != "align":
        return
    if locate_place(task, step.before, step.step.target or "").carrier == carrier:
        yield "xy"
        if step.step.tolerance_theta_rad is not None:
            yield "theta"
