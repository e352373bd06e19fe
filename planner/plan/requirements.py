"""What a plan needs of the station: ranges over all its steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from microplan.planner.assembly.assembly import Axis4, Carrier, axes_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.task.task import Task
from microplan.schemas import plan as p

AXES = ("x_um", "y_um", "z_um", "theta_rad")
CARRIERS: tuple[Carrier, ...] = ("robot", "stage")


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
    openings = [s.opening_um for state in states for s in (state.before, state.after)]
    return p.Requirements(
        width_px=camera.width_px,
        height_px=camera.height_px,
        pitch_um=camera.pitch_um,
        bits=camera.bits,
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
    for axes in ("robot", "stage"):
        if axes == "robot" and not any(state.before.tool for state in states):
            continue
        readings = list(_readings(states, axes))
        for name in AXES:
            values = [getattr(reading, name) for reading in readings]
            found[f"{axes}.{name}"] = _range(values or [0.0])
    return found


def _readings(states: Sequence[StepState], axes: str) -> Iterable[Axis4]:
    """Yield the readings of one axis group in every state."""
    for state in states:
        for moment in (state.before, state.at_look, state.after):
            yield moment.stage if axes == "stage" else moment.robot


def _range(values: Iterable[float]) -> tuple[float, float]:
    """Return the least and the most of `values`."""
    found = list(values)
    return (min(found), max(found))
