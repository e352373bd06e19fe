"""Requirements on the station, conditions of each step, reactions to failure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from microplan.planner.assembly.assembly import Axis4, Carrier, axes_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.task.task import Task
from microplan.schemas import plan as p

AXES = ("x_um", "y_um", "z_um", "theta_rad")
CARRIERS: tuple[Carrier, ...] = ("robot", "stage")
# What a look may be tried again for, and how often: noise is new every time.
RETRIES = (
    p.OnFailure(code="MP820", do="retry", times=2),
    p.OnFailure(code="MP821", do="retry", times=2),
    p.OnFailure(code="MP822", do="retry", times=1),
    p.OnFailure(code="MP825", do="retry", times=2),
    p.OnFailure(code="MP826", do="retry", times=1),
)


def conditions_of(here: StepState) -> p.Conditions:
    """Return the conditions before and after a step, with the retreat."""
    before, after = _facts(here)
    retreat = _retreat(here) if here.step.verb == "insert" else ()
    return p.Conditions(before=before, after=after, retreat=retreat, on_failure=RETRIES)


def _retreat(insert: StepState) -> tuple[p.AxisMove, ...]:
    """Return the insertion's moves backwards: each back to the reading before it."""
    at: dict[str, Axis4] = {"stage": insert.before.stage, "robot": insert.before.robot}
    back = []
    for move in insert.step.move:
        start = at[move.axes]
        held = {
            name: getattr(start, name)
            for name in AXES
            if getattr(move.to, name) is not None
        }
        back.append(p.AxisMove(axes=move.axes, **held))
        at[move.axes] = start.moved(move.to)
    return tuple(reversed(back))


def _facts(here: StepState) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the facts before and after the step that sensors can check."""
    step = here.step

    def held(name: str | None) -> str:
        return f"{name} is held" if name else "the tool holds nothing"

    before = [held(here.before.held)] if here.before.tool else []
    after = [held(here.after.held)] if here.after.tool else []
    if step.verb in ("locate", "align"):
        after.append(f"{step.target} is measured")
    if step.verb == "align":
        before.append(f"{step.target} and {step.to} are measured")
        after.append(f"{step.target} is at {step.to}")
    return tuple(before), tuple(after)


def requirements(
    task: Task, states: Sequence[StepState], steps: Sequence[p.Step]
) -> p.Requirements:
    """Return the ranges that the nominal run of `steps` uses.

    Corrections of a servo come on top; the executor checks them against the station's
    limits as they arise.
    """
    camera = task.workcell.camera
    looks = [look for step in steps for look in step.looks]
    zooms = [look.view.magnification for look in looks]
    low, _ = task.workcell.optics.magnification
    # what jaws are sent to: those that hold a part stop at it
    openings = [s.step.opening_um for s in states if s.step.opening_um is not None]
    openings += [s.before.opening_um for s in states]
    return p.Requirements(
        width_px=camera.width_px,
        height_px=camera.height_px,
        pitch_um=camera.pitch_um,
        bits=camera.bits,
        response=() if camera.response is None else camera.response.rows,
        magnification=_range(zooms or [low]),
        focus_um=_range(_focus_stops(steps) or [0.0]),
        opening_um=_range(openings or [0.0]),
        travel=_travel(states),
        theta_axis_um=task.workcell.stage.theta_axis_um,
        repeatability_um={
            name: axes_of(task, name).repeatability_xy_um for name in CARRIERS
        },
    )


def _focus_stops(steps: Sequence[p.Step]) -> list[float]:
    """Return every height the plan focuses on."""
    stops = [look.view.focus_um for step in steps for look in step.looks]
    stops += [z for s in steps for look in s.looks for z in look.view.focus_stops_um]
    for step in steps:
        if isinstance(step.action, p.VerifyAction) and step.action.height:
            stops += step.action.height.focus_um
    return stops


def _travel(states: Sequence[StepState]) -> dict[str, tuple[float, float]]:
    """Return the least and most reading of every axis."""
    found: dict[str, tuple[float, float]] = {}
    moments = [m for s in states for m in (s.before, s.at_look, s.after)]
    for axes in CARRIERS:
        if axes == "robot" and not any(state.before.tool for state in states):
            continue
        for name in AXES:
            values = [getattr(getattr(moment, axes), name) for moment in moments]
            found[f"{axes}.{name}"] = _range(values or [0.0])
    return found


def _range(values: Iterable[float]) -> tuple[float, float]:
    """Return the least and the most of `values`."""
    found = list(values)
    return (min(found), max(found))
