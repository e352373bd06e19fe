"""When each step of the task happens, as far as the plan tells times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from schemas.html.charts import Bar, bars
from schemas.html.elements import Element, el
from schemas.html.figures import quantity
from schemas.html.page import Caption, figure
from schemas.plan import AlignAction, AxisMove, InsertAction, Plan, Step
from schemas.world import World, WorldAxes

_AXES = ("x_um", "y_um", "z_um", "theta_rad")
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


def timeline(plan: Plan, world: World | None) -> Iterator[Element]:
    """Yield the timeline of the task."""
    found = spans(plan, world)
    if not found:
        return
    rows, at = [], 0.0
    for span in found:
        pieces = ((span.axes_s, "b1"), (span.lens_s, "b2"), (span.frames_s, "b3"),
                  (span.servo_s, ""))  # fmt: skip
        said = _said(span)
        rows.append(Bar(label=span.step, pieces=pieces, said=said, start=at))
        at += span.total_s
    open_ = [span.step for span in found if not span.told]
    words = "; ".join(f"{row.label} {row.said}" for row in rows)
    lacking = f"; not all times are known of {', '.join(open_)}" if open_ else ""
    chart = bars(f"Timeline, {quantity(at, 's')} in all", words, rows, unit="seconds",
                 most=max(at, 1e-6) * 1.02)  # fmt: skip
    caption = Caption(
        title=f"Timeline: about {quantity(at, 's')}",
        shows="When each step happens if every look finds its target at the first try: "
        "axes moving and settling, zoom and focus, exposures, and the further looks "
        "of a "
        f"servo (jaws, light and height sweeps have no stated time){lacking}.",
        judge="Good: the long bars are those that must be slow, as an insertion; bad: "
        "zoom and focus take most of it.",
        do="To save time, order looks of one magnification and focus behind each "
        "other.",
    )
    key = [("b1", "axes"), ("b2", "zoom and focus"), ("b3", "exposure"),
           ("", "servo")]  # fmt: skip
    legend = el("ul", [el("li", _swatch(kind), words) for kind, words in key],
                class_="key plain")  # fmt: skip
    yield figure(caption, chart, legend)


def _swatch(kind: str) -> Element:
    box = el("rect", x=2, y=3, width=24, height=8, class_=f"bar {kind}".strip())
    return el("svg", box, viewBox="0 0 28 14", aria_hidden="true")


def _said(span: Span) -> str:
    """Return how long a step takes, as far as it is known."""
    if span.told:
        return quantity(span.total_s, "s") if span.total_s else "no time stated"
    return f"more than {quantity(span.total_s, 's')}" if span.total_s else "not known"


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


def _travel_s(axes: WorldAxes, ways: Mapping[str, float], speed: float | None) -> float:
    """Return the time of the slowest axis, all at once, and settling."""
    if not any(ways.values()):
        return 0.0
    across = math.hypot(ways.get("x_um", 0.0), ways.get("y_um", 0.0))
    times = (
        across / (speed or axes.speed_xy_um_per_s),
        ways.get("z_um", 0.0) / (speed or axes.speed_z_um_per_s),
        ways.get("theta_rad", 0.0) / axes.speed_theta_rad_per_s,
    )
    return max(times) + axes.settle_s
