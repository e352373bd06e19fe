"""Predicted times of a plan's steps, as far as its world states them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from microplan.schemas.files.world import World, WorldAxes
from microplan.schemas.plan import (
    AlignAction,
    AxisMove,
    Control,
    GraspAction,
    InsertAction,
    LocateAction,
    Plan,
    ReleaseAction,
    Step,
    VerifyAction,
)

_AXES = ("x_um", "y_um", "z_um", "theta_rad")
JAWS, PROBE, SWEEP = "jaws", "probing moves", "the focus sweep"  # what a time lacks
LOOKS, MOVES = "its looks", "moves from where no plan knows"


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTimes:
    """What one step takes, by what it waits for."""

    step: str
    axes_s: float = 0.0
    lens_s: float = 0.0
    frames_s: float = 0.0
    servo_s: float = 0.0
    lacks: tuple[str, ...] = ()  # what it does whose time is not known

    @property
    def total_s(self) -> float:
        """Return the sum."""
        return self.axes_s + self.lens_s + self.frames_s + self.servo_s


def spans(plan: Plan, world: World | None) -> list[StepTimes]:
    """Return what each step takes: its looks by the plan, other moves by the axes.

    An alignment takes what its control says, approach and looks, the first among them;
    a focus sweep a move and a frame a stop, and one more frame at either end, as
    `microplan.executor.run.focus_sweep` has it.
    """
    now: dict[str, dict[str, float | None]] = {
        "stage": _reading(plan.stage_start),
        "robot": _reading(plan.robot_start),
    }
    probing = {step.id for step in plan.steps if probes(plan, step)}
    found = []
    for step in plan.steps:
        span = _looks(step)
        own = [_move_s(world, now, move) for move in step.moves]
        inserts = step.action.moves if isinstance(step.action, InsertAction) else ()
        acts = [_move_s(world, now, move) for move in inserts]
        if step.control is not None:
            lacks = span.lacks if None in own else ()  # the control counts its looks
            servo_s = _servo_s(step.control, own, span.total_s)
            span = replace(span, servo_s=servo_s, lacks=lacks)
        used = [*(() if step.looks else own), *acts]  # looks have them in their times
        span = replace(span, axes_s=span.axes_s + sum(t for t in used if t is not None))
        span = _with_sweep(span, step, world)
        lacking = {
            PROBE: step.id in probing,
            MOVES: None in used,
            JAWS: isinstance(step.action, GraspAction | ReleaseAction),
        }
        things = (name for name, there in lacking.items() if there)
        found.append(replace(span, lacks=(*span.lacks, *things)))
        if isinstance(step.action, AlignAction):
            # where it ends is measured, not planned
            now[step.action.axes].update(x_um=None, y_um=None, theta_rad=None)
    return found


def planned_s(plan: Plan, world: World | None) -> dict[str, float]:
    """Return how long the steps take of which all is known, seen at the first try."""
    return {
        span.step: span.total_s
        for span in spans(plan, world)
        if not span.lacks and 0 < span.total_s < math.inf
    }


def probes(plan: Plan, step: Step) -> bool:
    """Return whether a step's look is the first that leads to motions at its zoom.

    Then the axes that carry its target are moved, to see how they do; how far hangs on
    where the target is found, so that its time is not known.
    """
    before: set[float] = set()
    for other in plan.steps:
        moves = isinstance(other.action, LocateAction | AlignAction)
        zooms = {look.view.magnification for look in other.looks} if moves else set()
        if other is step:
            return bool(zooms) and zooms != before
        before = zooms or before
    return False


def _looks(step: Step) -> StepTimes:
    """Return what a step's looks wait for, each seen at the first try."""
    span = StepTimes(step=step.id)
    for look in step.looks:
        change = None if look.verdict is None else look.verdict.change
        if change is None:
            span = replace(span, lacks=(LOOKS,))
            continue
        for row in change.times:
            span = _added(span, row.what, row.time_s)
    return span


def _servo_s(control: Control, own: Sequence[float | None], first_s: float) -> float:
    """Return what an alignment takes beyond its first look.

    `own` are the times of the step's own moves, `first_s` is what the first look waits
    for; the control counts that look, and its approach as it is on average.
    """
    known = [time_s for time_s in own if time_s is not None]
    if len(known) < len(own):  # then by the looks that follow
        return control.expected_s * (1 - 1 / max(control.expected_cycles, 1.0))
    whole_s = sum(known) + control.approach_s + control.expected_s
    return max(whole_s - first_s, 0.0)


def _with_sweep(span: StepTimes, step: Step, world: World | None) -> StepTimes:
    """Return a span with a verification's focus sweep, if it has one.

    It comes after the step's looks. Both of its ends are taken twice.
    """
    search = step.action.height if isinstance(step.action, VerifyAction) else None
    if search is None:
        return span
    if world is None:
        return replace(span, lacks=(*span.lacks, SWEEP))
    stops = [*(look.view.focus_um for look in step.looks[-1:]), *search.focus_um]
    moves = sum(before != after for before, after in pairwise(stops))
    frames = len(search.focus_um) + 2
    return replace(
        span,
        lens_s=span.lens_s + moves * world.optics.focus_time_s,
        frames_s=span.frames_s + frames * world.optics.frame_time_s,
    )


def _added(span: StepTimes, what: str, time_s: float) -> StepTimes:
    """Return a span with one thing more that is waited for."""
    if what.startswith(("zoom", "focus", "light")):
        return replace(span, lens_s=span.lens_s + time_s)
    if what.startswith("exposure"):
        return replace(span, frames_s=span.frames_s + time_s)
    return replace(span, axes_s=span.axes_s + time_s)


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
