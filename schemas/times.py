"""When each step of a plan happens, as far as the plan and its world tell times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from schemas.plan import AlignAction, AxisMove, InsertAction, Plan, Step
from schemas.world import World, WorldAxes

_AXES = ("x_um", "y_um", "z_um", "theta_rad")
_MOVING = ("move", "insert")  # verbs
Readings = Mapping[str, Mapping[str, float | None]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """What one step takes, by what it waits for."""

    step: str
    axes_s: float = 0.0
    lens_s: float = 0.0
    frames_s: float = 0.0
    servo_s: float = 0.0
    told: bool = True  # False: something in it has no known time

    @property
    def total_s(self) -> float:
        """Return the sum."""
        return self.axes_s + self.lens_s + self.frames_s + self.servo_s


def spans(plan: Plan, world: World | None) -> list[Span]:
    """Return what each step takes: its looks by the plan, other moves by the axes."""
    now: dict[str, dict[str, float | None]] = {
        "stage": _reading(plan.stage_start),
        "robot": _reading(plan.robot_start),
    }
    found = []
    for step in plan.steps:
        span = Span(step=step.id)
        for look in step.looks:
            change = None if look.verdict is None else look.verdict.change
            for row in () if change is None else change.times:
                span = _added(span, row.what, row.time_s)
        if step.control is not None:
            span = replace(span, servo_s=span.servo_s + step.control.expected_s)
        moves = (*(() if step.looks else step.moves), *_of_action(step))
        times = [_move_s(world, now, move) for move in (*step.moves, *_of_action(step))]
        used = times[-len(moves) :] if moves else []
        span = replace(
            span,
            axes_s=span.axes_s + sum(t for t in used if t is not None),
            told=None not in used,
        )
        if isinstance(
            step.action, AlignAction
        ):  # where it ends is measured, not planned
            now[step.action.axes].update(x_um=None, y_um=None, theta_rad=None)
        found.append(span)
    return found


def moving_s(plan: Plan, world: World | None) -> dict[str, float]:
    """Return how long the steps take that do nothing but move, and settle.

    Steps that look, close or open jaws are left out: what they take hangs on what is
    seen, or is stated nowhere. So are moves from where no plan knows.
    """
    only = {step.id for step in plan.steps if step.verb in _MOVING and not step.looks}
    return {
        span.step: span.total_s
        for span in spans(plan, world)
        if span.step in only and span.told and 0 < span.total_s < math.inf
    }


def _added(span: Span, what: str, time_s: float) -> Span:
    """Return a span with one thing more that is waited for."""
    if what.startswith(("zoom", "focus", "light")):
        return replace(span, lens_s=span.lens_s + time_s)
    if what.startswith("exposure"):
        return replace(span, frames_s=span.frames_s + time_s)
    return replace(span, axes_s=span.axes_s + time_s)


def _of_action(step: Step) -> tuple[AxisMove, ...]:
    return step.action.moves if isinstance(step.action, InsertAction) else ()


def _reading(move: AxisMove | None) -> dict[str, float | None]:
    return {axis: getattr(move, axis, None) for axis in _AXES}


def _move_s(
    world: World | None, now: dict[str, dict[str, float | None]], move: AxisMove
) -> float | None:
    """Return how long a move takes with settling, and make it; None: not known."""
    here = now[move.axes]
    asked = {a: v for a in _AXES if (v := getattr(move, a)) is not None}
    before = {axis: here[axis] for axis in asked}
    here.update(asked)
    if world is None or None in before.values():
        return None
    ways = {axis: abs(asked[axis] - (before[axis] or 0.0)) for axis in asked}
    axes = world.stage if move.axes == "stage" else world.robot
    return _travel_s(axes, ways, move.speed_um_per_s)


def _travel_s(
    axes: WorldAxes, ways: Mapping[str, float], speed: float | None
) -> float | None:
    """Return the time of the slowest axis, all at once, and settling."""
    if not any(ways.values()):
        return 0.0
    own = (axes.speed_xy_um_per_s, axes.speed_z_um_per_s, axes.speed_theta_rad_per_s)
    if not min(*own, *(() if speed is None else (speed,))) > 0:
        return None  # a damaged world
    across = math.hypot(ways.get("x_um", 0.0), ways.get("y_um", 0.0))
    times = (
        across / (speed or axes.speed_xy_um_per_s),
        ways.get("z_um", 0.0) / (speed or axes.speed_z_um_per_s),
        ways.get("theta_rad", 0.0) / axes.speed_theta_rad_per_s,
    )
    return max(times) + axes.settle_s
