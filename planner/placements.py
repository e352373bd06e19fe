"""Putting a part down where no shaft holds it: from looks and moves to its budget."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely

from planner.checks.budget import Sighted, blind_rows
from planner.checks.fit import Residual
from planner.checks.insert_budget import Left, share_of_goal
from planner.checks.placing import Placement, placing_budget
from planner.checks.turning import Turning
from planner.control import gain_of, moved_by, residual_of, single_residual
from planner.inputs.task import Move, Part, Step, Task
from planner.memory import Memory
from planner.model.assembly import (
    Carrier,
    State,
    axes_of,
    inner_center,
    locate_place,
    owner_of,
    part_pose,
    part_sigma_um,
)
from planner.model.moves import apply_reading
from planner.model.shapes import hull
from planner.model.steps import StepState
from planner.model.sweep import ROUNDING_UM
from planner.model.targets import middle_um
from schemas.plan import Budget, BudgetRow
from schemas.verdicts import PlacingVerdict, TurnRow

Point = tuple[float, float]
LEVER = "angle of {} over the way to what is placed"
TURNED = "turn that the alignment leaves"


@dataclass(frozen=True, slots=True, kw_only=True)
class Putting:
    """A release, the step that checks it, and what brought the part there."""

    task: Task
    release: StepState
    verify: Step
    align: StepState | None  # None: nothing did, or it was undone
    since_align: tuple[StepState, ...]  # up to the release
    since_seen: tuple[StepState, ...]  # the last look at the part, up to the release
    memory: Memory

    @property
    def part(self) -> str:
        """Return the part that is put down."""
        return owner_of(self.release.step.target or "")

    @property
    def seat(self) -> str:
        """Return the part that it is put beside."""
        return owner_of(self.verify.on or "")

    @property
    def seen(self) -> tuple[Sighted | None, Sighted | None]:
        """Return the last looks at part and seat."""
        return (self.memory.seen.get(self.part), self.memory.seen.get(self.seat))

    @property
    def turns(self) -> bool:
        """Return whether the alignment corrects the angle."""
        return (
            self.align is not None and self.align.step.tolerance_theta_rad is not None
        )


def place_budget(
    task: Task, states: tuple[StepState, ...], here: StepState, memory: Memory
) -> tuple[Budget, PlacingVerdict] | None:
    """Return what a release leaves of a placement, None if nobody states a tolerance.

    A part on a shaft is the insertion's.
    """
    put = putting_of(task, states, here, memory)
    if put is None:
        return None
    placed = Placement(
        target=put.verify.target or "",
        on=put.verify.on or "",
        verified_by=put.verify.id,
        within_um=put.verify.within_um or 0.0,
        within_rad=put.verify.within_rad,
        far_um=_far_um(task.parts[put.part], put.verify.target or ""),
        stick_probability=_stick(task, here),
    )
    turning = _turning(put)
    return placing_budget(
        task,
        placed,
        _left(put, turning),
        (*_blind(put), *_levers(put, turning)),
        turning,
        offset_um=_offset_um(put),
        goal=share_of_goal(task),
        seen=put.seen,
    )


def putting_of(
    task: Task, states: tuple[StepState, ...], here: StepState, memory: Memory
) -> Putting | None:
    """Return what is put down by a release, None if no later step states where."""
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
    looked = [
        k
        for k, state in enumerate(held)
        if state.step.verb in ("locate", "align")
        and owner_of(state.step.target or "") == part
    ]
    path = (*held, here)
    return Putting(
        task=task,
        release=here,
        verify=verify,
        align=held[aligned[-1]] if aligned else None,
        since_align=path[aligned[-1] + 1 :] if aligned else (),
        since_seen=path[looked[-1] + 1 :] if looked else path[1:],
        memory=memory,
    )


def _verify_after(task: Task, release: Step) -> Step | None:
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


def _owners(align: Step) -> set[str]:
    return {owner_of(name or "") for name in (align.target, align.to)}


def _stick(task: Task, release: StepState) -> float:
    """Return the chance that the part follows a finger."""
    tool = release.before.tool
    return 0.0 if tool is None else task.workcell.tools[tool].stick_probability


def _offset_um(put: Putting) -> float:
    """Return how far apart the moves leave what is to be in one place."""
    after = put.release.after
    target, on = (
        locate_place(put.task, after, name or "").pose
        for name in (put.verify.target, put.verify.on)
    )
    off_um = math.hypot(target.x_um - on.x_um, target.y_um - on.y_um)
    return off_um if off_um > ROUNDING_UM else 0.0


def _left(put: Putting, turning: Turning) -> Left:
    """Return what the alignment leaves sideways.

    A servo may end at its first look: then the error is that of the approach, by the
    look before, if place and angle are within their tolerances. Every later look
    follows a correction, e+ = (1 - g) e + the axes' own.
    """
    task, align = put.task, put.align
    if align is None:
        spread = [
            part_sigma_um(task, put.release.before, n) for n in (put.part, put.seat)
        ]
        return Left(
            residual=Residual(sigma_um=math.hypot(*spread), within_um=math.inf),
            term="places of both parts",
            source="no alignment of them since the part was taken",
        )
    carrier = moved_by(task, align)
    if put.memory.choice is not None and put.memory.choice.method == "look_then_move":
        return Left(
            residual=single_residual(task, carrier),
            term=f"{carrier} repeatability left by two moves",
            source="workcell repeatability_xy_um, nothing cut off",
        )
    within_um, before = put.memory.within_um, put.memory.before
    settled = residual_of(task, within_um, carrier)
    known_um = (
        part_sigma_um(task, align.before, owner_of(align.step.target or ""))
        if before is None
        else before.sigma_um
    )
    first = Residual(
        sigma_um=math.hypot(
            single_residual(task, carrier).sigma_um, known_um, _swing_um(put, align)
        ),
        within_um=within_um,
    )
    later_um = math.hypot(settled.sigma_um, (1 - gain_of(task)) * first.sigma_um)
    share = first.inside * turning.left_inside
    return Left(
        residual=Residual(sigma_um=later_um, within_um=within_um),
        early=(share, first),
        term="what the servo leaves",
        source=f"workcell repeatability_xy_um, cut off at {within_um:.3g} um; with "
        f"{share:.3g} the first look ends it, by the look before ({known_um:.3g} um)",
    )


def _swing_um(put: Putting, align: StepState) -> float:
    """Return how far turns that do not repeat swing what is aligned, one sigma."""
    if align.step.tolerance_theta_rad is None:
        return 0.0
    task, carrier = put.task, moved_by(put.task, align)
    target = locate_place(task, align.at_look, align.step.target or "").pose
    arm_um = task.workcell.robot.theta_axis_to_tip_um
    if carrier == "stage":
        stage, axis = align.at_look.stage, task.workcell.stage.theta_axis_um
        arm_um = math.hypot(
            target.x_um - stage.x_um - axis[0], target.y_um - stage.y_um - axis[1]
        )
    return math.sqrt(2) * axes_of(task, carrier).repeatability_theta_rad * arm_um


def _turning(put: Putting) -> Turning:
    """Return the error of the part's angle against its seat's."""
    task, align, state = put.task, put.align, put.release.before
    spread = [state.parts[name].sigma_theta_rad for name in (put.part, put.seat)]
    since = list(_since_turns(put))
    if align is None or align.step.tolerance_theta_rad is None:
        left = math.hypot(*spread, task.workcell.stage.axes.repeatability_theta_rad)
        return Turning(left_rad=left, cut_rad=math.inf, rows=tuple(since))
    repeats = axes_of(task, moved_by(task, align)).repeatability_theta_rad
    rows = [
        TurnRow(
            term=f"angle of {name if seen is None else seen.name}",
            sigma_rad=_angle_rad(seen, wide),
            source="trials"
            if seen is not None and seen.sigma_theta_rad is not None
            else "not measured: its spread in the task",
        )
        for name, seen, wide in zip((put.part, put.seat), put.seen, spread, strict=True)
    ]
    if put.memory.choice is not None and put.memory.choice.method == "look_then_move":
        left, cut = math.sqrt(2) * repeats, math.inf
    else:
        before = put.memory.before
        known = spread[owner_of(align.step.target or "") == put.seat]
        first = math.hypot(_angle_rad(before, known), math.sqrt(2) * repeats)
        left = max(repeats * math.sqrt(2 / (2 - gain_of(task))), first)
        cut = align.step.tolerance_theta_rad
    return Turning(left_rad=left, cut_rad=cut, rows=(*rows, *since))


def _angle_rad(seen: Sighted | None, spread_rad: float) -> float:
    """Return how well an angle is known: by the look, else as the task has it."""
    if seen is None or seen.sigma_theta_rad is None:
        return spread_rad
    return seen.sigma_theta_rad


def _blind(put: Putting) -> Iterator[BudgetRow]:
    """Yield the terms of the place that the alignment cannot see."""
    task, release = put.task, put.release.before
    start = release if put.align is None else put.align.after
    first = put.since_seen[0].before if put.since_seen else release
    travel: dict[Carrier, float] = {
        "stage": abs(release.stage.z_um - start.stage.z_um),
        "robot": abs(release.robot.z_um - first.robot.z_um),
    }
    seen = put.seen if put.align is not None else (None, None)
    takes_s = _moves_s(task, put.since_align)
    yield from blind_rows(task.workcell, travel, *seen, takes_s, doing="placing")
    for carrier, steps in _since(put):
        if any(_sideways(move) for move in _moves(steps, carrier)):
            yield BudgetRow(
                term=f"{carrier} moves since it was measured",
                sigma_um=single_residual(task, carrier).sigma_um,
                source="workcell repeatability_xy_um, of two places",
            )


def _since_turns(put: Putting) -> Iterator[TurnRow]:
    """Yield what turns of the axes add after the looks."""
    for carrier, steps in _since(put):
        moves = _moves(steps, carrier)
        if any(move.to.theta_rad is not None for move in moves):
            repeats = axes_of(put.task, carrier).repeatability_theta_rad
            yield TurnRow(
                term=f"{carrier} turns since it was measured",
                sigma_rad=math.sqrt(2) * repeats,
                source="workcell repeatability_theta_arcsec, of two places",
            )


def _since(put: Putting) -> tuple[tuple[Carrier, Sequence[StepState]], ...]:
    """Return the steps in which each carrier must stand still."""
    return (("stage", put.since_align), ("robot", put.since_seen))


def _moves(steps: Sequence[StepState], carrier: Carrier) -> list[Move]:
    return [move for here in steps for move in here.moves if move.axes == carrier]


def _sideways(move: Move) -> bool:
    to = move.to
    return not (to.x_um is None and to.y_um is None and to.theta_rad is None)


def _moves_s(task: Task, steps: Sequence[StepState]) -> float:
    """Return how long the moves of steps take, settling included."""
    total = 0.0
    for here in steps:
        state = here.before
        for move in here.moves:
            after = apply_reading(task, state, move.axes, move.to)
            total += _move_s(task, state, after, move.axes)
            state = after
    return total


def _move_s(task: Task, before: State, after: State, carrier: Carrier) -> float:
    axes = axes_of(task, carrier)
    a, b = (s.stage if carrier == "stage" else s.robot for s in (before, after))
    return axes.settle_s + max(
        math.hypot(b.x_um - a.x_um, b.y_um - a.y_um) / axes.speed_xy_um_per_s,
        abs(b.z_um - a.z_um) / axes.speed_z_um_per_s,
        abs(b.theta_rad - a.theta_rad) / axes.speed_theta_rad_per_s,
    )


def _levers(put: Putting, turning: Turning) -> Iterator[BudgetRow]:
    """Yield what errors of angles move what is placed."""
    if put.align is None:
        return
    state = put.release.before
    for name, seen, point in zip(
        (put.part, put.seat), put.seen, (put.verify.target, put.verify.on), strict=True
    ):
        if seen is None:
            continue
        sigma = _angle_rad(seen, state.parts[name].sigma_theta_rad)
        way = _way_um(put, name, seen.name, point or "")
        yield from _lever(LEVER.format(seen.name), sigma, way)
    aligned = next(
        n
        for n in (put.align.step.target, put.align.step.to)
        if owner_of(n or "") == put.part
    )
    way = _way_um(put, put.part, aligned or "", put.verify.target or "")
    left = Turning(left_rad=turning.left_rad, cut_rad=turning.cut_rad, rows=())
    yield from _lever(TURNED, left.sigma_rad, way)


def _lever(term: str, sigma_rad: float, way_um: Point) -> Iterator[BudgetRow]:
    """Yield what an angle moves at the end of a way, across it; nothing if short."""
    arm_um = math.hypot(*way_um)
    if arm_um > ROUNDING_UM:
        yield BudgetRow(
            term=term,
            sigma_um=min(sigma_rad, 1.0) * arm_um,
            source=f"{min(sigma_rad, 1.0) * 1e3:.3g} mrad x {arm_um:.4g} um",
            along_rad=math.atan2(way_um[1], way_um[0]) + math.pi / 2,
        )


def _way_um(put: Putting, name: str, start: str, end: str) -> Point:
    """Return the way between two points of a part, in the world's axes."""
    part, pose = put.task.parts[name], part_pose(put.task, put.release.before, name)
    (x0, y0), (x1, y1) = (pose.apply(*_point_um(part, n)) for n in (start, end))
    return (x1 - x0, y1 - y0)


def _point_um(part: Part, name: str) -> Point:
    """Return a named point in its part's frame."""
    inner = name.partition(".")[2]
    if inner == "outline" and inner not in part.features:
        return middle_um(part)
    return inner_center(part, inner)


def _far_um(part: Part, target: str) -> float:
    """Return the distance from a point of the part to its farthest corner."""
    x, y = _point_um(part, target)
    corners = shapely.get_coordinates(hull(part.outline))
    return max(math.hypot(cx - x, cy - y) for cx, cy in corners)
