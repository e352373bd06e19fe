"""Placement context of a release: the steps before that determine its errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely

from microplan.arrays import Point
from microplan.planner.assembly.assembly import (
    axes_of,
    inner_center,
    owner_of,
    part_pose,
)
from microplan.planner.assembly.shapes import hull
from microplan.planner.assembly.step_states import StepState, apply_reading
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.task.task import Part, Task, TaskStep
from microplan.planner.views.targets import middle_um
from microplan.planner.views.view_times import move_times


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementContext:
    """A release, the step that verifies it, and the steps that brought the part."""

    task: Task
    states: tuple[StepState, ...]
    release: StepState
    verify: TaskStep
    align: StepState | None  # None: nothing did, or it was undone
    since_align: tuple[StepState, ...]  # up to the release
    since_seen: tuple[StepState, ...]  # the last look at the part, up to the release
    history: MeasurementHistory
    held: tuple[StepState, ...] = ()  # from the grasp up to the release
    turned: StepState | None = None  # the last alignment that corrected the angle
    since_turned: tuple[StepState, ...] = ()  # up to the release

    @property
    def part(self) -> str:
        """Return the part that is put down."""
        return owner_of(self.release.step.target or "")

    @property
    def seat(self) -> str:
        """Return the part that it is placed against."""
        return owner_of(self.verify.on or "")

    @property
    def seen(self) -> tuple[PastMeasurement | None, PastMeasurement | None]:
        """Return the last looks at part and seat."""
        return (self.history.seen.get(self.part), self.history.seen.get(self.seat))

    @property
    def angles_seen(self) -> tuple[PastMeasurement | None, PastMeasurement | None]:
        """Return the last looks that measured the angles of part and seat."""
        return (self._angle_seen(self.part), self._angle_seen(self.seat))

    def _angle_seen(self, name: str) -> PastMeasurement | None:
        """Return the last look since the grasp that measured the angle of a part."""
        last = self.history.seen.get(name)
        if last is None or last.sigma_theta_rad is None:
            last = self.history.angles.get(name)
        held = {here.step.id for here in self.held}
        return last if last is not None and last.step in held else None


def placement_context(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    history: MeasurementHistory,
) -> PlacementContext | None:
    """Return the placement of a release, None if no later step specifies one."""
    index, part = states.index(here), owner_of(here.step.target or "")
    verify = _verify_after(task, here.step)
    if verify is None or verify.on is None:
        return None
    taken = max((k for k in range(index) if _is(states[k], "grasp", part)), default=0)
    held = states[taken:index]
    if any(_is(state, "insert", part) for state in held):
        return None
    pair = {part, owner_of(verify.on)}
    aligned = [
        k
        for k, state in enumerate(held)
        if state.step.verb == "align" and pair == _owners(state.step)
    ]
    turning = [k for k in aligned if held[k].step.tolerance_theta_rad is not None]
    looked = [
        k
        for k, state in enumerate(held)
        if state.step.verb in ("locate", "align")
        and owner_of(state.step.target or "") == part
    ]
    path = (*held, here)
    return PlacementContext(
        task=task,
        states=states,
        release=here,
        verify=verify,
        align=held[aligned[-1]] if aligned else None,
        since_align=path[aligned[-1] + 1 :] if aligned else (),
        since_seen=path[looked[-1] + 1 :] if looked else path[1:],
        history=history,
        held=tuple(held),
        turned=held[turning[-1]] if turning else None,
        since_turned=path[turning[-1] + 1 :] if turning else (),
    )


def _verify_after(task: Task, release: TaskStep) -> TaskStep | None:
    """Return the step that checks where the part lies, before it is taken again."""
    part = owner_of(release.target or "")
    for step in task.steps[task.steps.index(release) + 1 :]:
        if owner_of(step.target or "") == part:
            if step.verb == "verify":
                return step
            if step.verb == "grasp":
                return None
    return None


def _is(state: StepState, verb: str, part: str) -> bool:
    return state.step.verb == verb and owner_of(state.step.target or "") == part


def _owners(align: TaskStep) -> set[str]:
    return {owner_of(name or "") for name in (align.target, align.to)}


def moves_s(task: Task, steps: Sequence[StepState]) -> float:
    """Return the time of the moves of steps, s, settling included."""
    total = 0.0
    for here in steps:
        state = here.before
        for move in here.moves:
            after = apply_reading(task, state, move.axes, move.to)
            a, b = (
                s.stage if move.axes == "stage" else s.robot for s in (state, after)
            )
            times = move_times(axes_of(task, move.axes), move.axes, a, b)
            total += sum(row.time_s for row in times)
            state = after
    return total


def lever_um(put: PlacementContext, name: str, start: str, end: str) -> Point:
    """Return the vector between two points of a part, um in the world."""
    part, pose = put.task.parts[name], part_pose(put.task, put.release.before, name)
    (x0, y0), (x1, y1) = (pose.apply(*_point_um(part, n)) for n in (start, end))
    return (x1 - x0, y1 - y0)


def _point_um(part: Part, name: str) -> Point:
    """Return a named point in its part's frame."""
    inner = name.partition(".")[2]
    if inner == "outline" and inner not in part.features:
        return middle_um(part)
    return inner_center(part, inner)


def far_um(part: Part, target: str) -> float:
    """Return the distance from a point of the part to its farthest corner."""
    x, y = _point_um(part, target)
    corners = shapely.get_coordinates(hull(part.outline))
    return max(math.hypot(cx - x, cy - y) for cx, cy in corners)
