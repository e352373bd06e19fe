"""Resumption of a run that another executor left: read the devices, decide, go on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES, Rules
from microplan.executor.record.recovery import Header, ResumeState
from microplan.executor.record.write_ahead_log import (
    FORMAT,
    REPEATED,
    DriveReadings,
    Intent,
)
from microplan.executor.run.run_context import Rig

Was = Literal["done", "not begun", "on the way"]
Ask = Callable[[str], bool]


def begin(rig: Rig, header: Header) -> None:
    """Note in the journal what a run begins with."""
    rig.write_ahead.write("run", format=FORMAT, header=header, standing=rig.standing())


def take_up(rig: Rig, state: ResumeState, ask: Ask | None = None) -> None:
    """Make a rig ready to go on where another executor was.

    Everything is stopped first, then read, and nothing moves until it is clear how far
    the last motion went. The decision goes into the journal.

    Parameters
    ----------
    rig : Rig
        Of the same plan and station; `run_plan` goes on with it.
    state : ResumeState
        The state by the journal.
    ask : callable or None
        Put a question to the operator and return whether to go on; None without
        an operator.

    Raises
    ------
    ExecutorError
        MP841 or MP845 if something cannot be stopped; MP864 if an irreversible motion
        is half done and no operator lets it go on; MP865 if the station is not
        where the journal left it; codes of readings.
    """
    rig.motion.rest(rig.station)
    now = rig.standing()
    was = decide(state, now, rig.station.rules)
    intent = state.opened
    if intent is not None and was == "on the way":
        if intent.irreversible:
            _let_go_on(intent, now, ask)
        if intent.name not in REPEATED:
            state.again = intent
    rig.journal.write("resumed", step=state.step, motion=intent, was=was)
    rig.write_ahead.write("resumed", was=was, standing=now)
    if state.known is not None:
        rig.beliefs.restore(state.known)
    state.close(was == "done", now)
    rig.resume_state, rig.phase = state, state.phase
    _restore_view(rig, state)


def decide(state: ResumeState, now: DriveReadings, rules: Rules) -> Was:
    """Return the progress of the motion that the journal leaves open.

    Parameters
    ----------
    state : ResumeState
        The state by the journal; without an open motion all must be where it was.
    now : DriveReadings
        What the devices read.
    rules : Rules
        Windows: one for the reading before, one for the reading now.

    Raises
    ------
    ExecutorError
        MP865 if something is elsewhere.
    """
    intent = state.opened
    before = state.standing if intent is None else intent.before
    if before is None:
        raise ExecutorError("MP865", "the journal tells no readings")
    target = {} if intent is None else _target_readings(intent.device, intent.target)
    was, is_now = _flat(before), _flat(now)
    if was.keys() != is_now.keys():
        raise ExecutorError("MP865", f"it had {list(was)}, now {list(is_now)}")
    for name, reading in is_now.items():
        _check_on_the_way(name, was[name], reading, target.get(name), rules)
    if intent is None:
        return "not begun"
    if all(abs(is_now[n] - v) <= _window(n, rules) for n, v in target.items()):
        return "done"
    if all(abs(is_now[n] - was[n]) <= 2 * _window(n, rules) for n in target):
        return "not begun"
    return "on the way"


def _check_on_the_way(
    name: str, was: float, now: float, target: float | None, rules: Rules
) -> None:
    """Raise MP865 unless a reading lies between where it was and where it went."""
    ends = (was, was if target is None else target)
    slack = 2 * _window(name, rules)
    if min(ends) - slack <= now <= max(ends) + slack:
        return
    went = "" if target is None else f", and was sent to {target:.6g}"
    raise ExecutorError("MP865", f"{name} reads {now:.6g}, it was at {was:.6g}{went}")


def _let_go_on(intent: Intent, now: DriveReadings, ask: Ask | None) -> None:
    """Return if the operator lets a half-done irreversible motion go on."""
    was, is_now = _flat(intent.before), _flat(now)
    under_way = ", ".join(
        f"{name} is at {is_now[name]:.6g} on its way from {was[name]:.6g} to {v:.6g}"
        for name, v in _target_readings(intent.device, intent.target).items()
    )
    what = f"step {intent.step}: {under_way}"
    if ask is None:
        raise ExecutorError("MP864", f"{what}; run at a terminal to be asked")
    if not ask(f"{what}; may it go on?"):
        raise ExecutorError("MP864", f"{what}; the operator did not let it go on")


def _restore_view(rig: Rig, state: ResumeState) -> None:
    """Keep the zoom if it reads what it was sent to; focus and light are set anew.

    A zoom that is sent where it is may still land a little elsewhere, and looks before
    and after must share the image's jump.
    """
    if state.view is None:
        return
    reading = rig.motion.magnification(rig.station)
    within = rig.station.rules.zoom_window * abs(state.view.magnification)
    if abs(reading - state.view.magnification) <= within:
        rig.view = replace(state.view, focus_um=math.nan, light=math.nan)


def _flat(standing: DriveReadings) -> dict[str, float]:
    """Return all readings by name."""
    found: dict[str, float] = {}
    for group, reading in (("stage", standing.stage), ("robot", standing.robot)):
        if reading is not None:
            found |= {f"{group}.{axis}": getattr(reading, axis) for axis in AXES}
    if standing.opening_um is not None:
        found["jaws.opening_um"] = standing.opening_um
    return found


def _target_readings(device: str, target: Mapping[str, float]) -> dict[str, float]:
    """Return a motion's targets by the names of readings."""
    return {f"{device}.{axis}": value for axis, value in target.items()}


def _window(name: str, rules: Rules) -> float:
    """Return how far a reading may be from where it belongs, um or rad."""
    device, _, axis = name.partition(".")
    if device == "jaws":
        return rules.jaws_window_um
    return rules.settle("stage" if device == "stage" else "robot").window(axis)
