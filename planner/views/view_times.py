"""Time or errors of a change from one look's setting to the next."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from microplan.planner.assembly.assembly import Axis4, Carrier, axes_of, locate_place
from microplan.planner.assembly.step_states import StepState
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import AxesSpec, Workcell
from microplan.schemas.plan import Look, View
from microplan.schemas.plan.views import TimeRow, ViewChange


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroscopeSetting:
    """What the microscope is set to, and the look that set it."""

    look: str
    view: View


def view_change(
    task: Task, look: Look, before: MicroscopeSetting | None, waits: Sequence[TimeRow]
) -> ViewChange:
    """Return what it takes to look, all going as planned and seen at the first try.

    `waits` are for the axes that move before it. Zoom, focus and light are set where
    they change. What centres a target takes its time before, and back after the frame.
    """
    cell, view = task.workcell, look.view
    old = None if before is None else before.view
    zoomed = old is None or old.magnification != view.magnification
    travel_um = None if old is None else abs(view.focus_um - old.focus_um)
    times = (*waits, *_settings(cell, old, view), _frame(cell), *_back(look, waits))
    return ViewChange(
        since=None if before is None else before.look,
        parcentric_sigma_um=cell.optics.zoom.parcentric_sigma_um
        if zoomed and old is not None
        else 0.0,
        focus_um=travel_um,
        lateral_sigma_um=cell.optics.focus.lateral_sigma_um_per_um * (travel_um or 0.0),
        times=times,
        total_s=sum(row.time_s for row in times),
    )


def approach_times(task: Task, here: StepState) -> tuple[TimeRow, ...]:
    """Return how long the axes move and settle before a step's first look.

    The step's own moves; for an alignment its first approach as well, where the parts
    are nominally.
    """
    state = here.before
    rows: list[TimeRow] = []
    for move in here.moves:
        there = state.axes(move.axes).moved(move.to)
        axes = axes_of(task, move.axes)
        rows += move_times(axes, move.axes, state.axes(move.axes), there)
        state = state.carried(move.axes, there)
    if here.path:
        carrier = locate_place(task, here.before, here.step.target or "").carrier
        end = here.at_look.axes(carrier)
        rows += _legs(
            axes_of(task, carrier), carrier, state.axes(carrier), end, here.path
        )
    return tuple(rows)


def setting_time_s(task: Task, here: StepState, look: Look) -> float:
    """Return what zoom and focus take before a step's first look.

    Raises
    ------
    ValueError
        If the look has no verdict.
    """
    if look.verdict is None or look.verdict.change is None:
        raise ValueError(f"look {look.id} has no times")
    waits_s = sum(row.time_s for row in approach_times(task, here))
    return look.verdict.change.total_s - waits_s - _frame(task.workcell).time_s


def centre_times(task: Task, carrier: Carrier, sigma_um: float) -> tuple[TimeRow, ...]:
    """Return how long a target that is off by `sigma_um` per axis takes to centre.

    Its distance is the mean of a Rayleigh distribution, sigma sqrt(pi / 2).
    """
    axes = axes_of(task, carrier)
    distance_um = sigma_um * math.sqrt(math.pi / 2)
    return (
        TimeRow(
            what=f"{carrier} centres the target, {distance_um:.3g} um on average",
            time_s=distance_um / axes.speed_xy_um_per_s,
        ),
        TimeRow(what=f"{carrier} settles", time_s=axes.settle_s),
    )


def move_times(
    axes: AxesSpec, carrier: Carrier, start: Axis4, end: Axis4
) -> Iterator[TimeRow]:
    """Yield how long axes travel, all at once, and settle; nothing if they stay."""
    across_um = math.hypot(end.x_um - start.x_um, end.y_um - start.y_um)
    up_um, turn_rad = abs(end.z_um - start.z_um), abs(end.theta_rad - start.theta_rad)
    if start == end:
        return
    travels = (
        (across_um, "um across", axes.speed_xy_um_per_s),
        (up_um, "um in z", axes.speed_z_um_per_s),
        (turn_rad, "rad", axes.speed_theta_rad_per_s),
    )
    said = ", ".join(f"{travel:.4g} {unit}" for travel, unit, _ in travels if travel)
    yield TimeRow(
        what=f"{carrier} moves {said}",
        time_s=max(travel / speed for travel, _, speed in travels),
    )
    yield TimeRow(what=f"{carrier} settles", time_s=axes.settle_s)


def _legs(
    axes: AxesSpec, carrier: Carrier, start: Axis4, end: Axis4, path: Sequence[str]
) -> Iterator[TimeRow]:
    """Yield the times of an approach, one entry of its path after the other."""
    here = start
    for leg in path:
        there = Axis4(
            x_um=end.x_um if "x" in leg else here.x_um,
            y_um=end.y_um if "y" in leg else here.y_um,
            z_um=here.z_um,
            theta_rad=end.theta_rad,
        )
        yield from move_times(axes, carrier, here, there)
        here = there


def _settings(cell: Workcell, old: View | None, view: View) -> Iterator[TimeRow]:
    """Yield the times of the microscope's drives, each only if it has to move."""
    if old is None or old.magnification != view.magnification:
        what = f"zoom to {view.magnification:.4g} x"
        yield TimeRow(what=what, time_s=cell.optics.zoom.time_s)
    if old is None or old.focus_um != view.focus_um:
        what = f"focus to {view.focus_um:.4g} um"
        yield TimeRow(what=what, time_s=cell.optics.focus.time_s)
    if old is None or old.light != view.light:
        yield TimeRow(what="light: the workcell states no time", time_s=0.0)


def _frame(cell: Workcell) -> TimeRow:
    """Return the time of one frame."""
    return TimeRow(what="exposure and readout", time_s=1 / cell.camera.rate_hz)


def _back(look: Look, waits: Sequence[TimeRow]) -> Iterator[TimeRow]:
    """Yield the return of a target that was centred for the look."""
    if look.coarse is not None:
        for row in waits:
            yield TimeRow(what=f"{row.what} (back)", time_s=row.time_s)
