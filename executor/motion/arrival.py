"""Arrival of an axis group: settled, under way, or failed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import (
    AXES,
    MotionProgress,
    check_travel,
    outside,
)
from microplan.executor.devices.station import Station
from microplan.schemas.plan import AxesName

SHORTEST_S = 1e-3  # a wait that moves any clock on


def arrive(
    station: Station,
    group: AxesName,
    read: Callable[[], tuple[AxisReading, bool]],
    start: AxisReading,
    target: Mapping[str, float],
    seconds: float,
) -> None:
    """Wait until the readings have stayed at the target; watch them meanwhile.

    Parameters
    ----------
    read : callable
        Gives the group's reading, and whether it reports motion.
    start : AxisReading
        The reading before the motion.
    target : mapping of str to float
        Targets of the axes that were ordered.
    seconds : float
        What distance and speed explain.

    Raises
    ------
    ExecutorError
        MP840, MP845, MP846, and those of `read`.
    """
    settle, clock = station.rules.settle(group), station.clock
    progress = MotionProgress(start, target, settle)
    there = all(getattr(start, axis) == value for axis, value in target.items())
    dwell_s = 0.0 if there else settle.dwell_s
    began_s = clock.now_s()
    inside_s, rest_s = math.inf, math.inf  # since when inside, since when at rest
    while True:
        reading, moving = read()
        now_s = clock.now_s()
        _check_inside(station, group, reading)
        away = dict(outside(reading, target, settle))
        inside_s = math.inf if away else min(inside_s, now_s)
        rest_s = math.inf if moving or not away else min(rest_s, now_s)
        if not (away or moving) and now_s - inside_s >= dwell_s:
            return
        late = now_s - began_s > seconds + settle.timeout_s
        if late or now_s - rest_s > settle.stall_s / 2:
            raise ExecutorError("MP845", _not_there(group, away, now_s - began_s))
        progress.check(group, reading, now_s)
        left_s = inside_s + dwell_s - now_s  # may be infinite
        wait_s = min(station.rules.safety.poll_s, left_s if left_s > 0 else math.inf)
        clock.wait(max(wait_s, SHORTEST_S))


def _check_inside(station: Station, group: AxesName, reading: AxisReading) -> None:
    """Raise MP840 if a moving axis is beyond its limits by more than its window."""
    settle = station.rules.settle(group)
    for axis in AXES:
        name = f"{group}.{axis}"
        if name not in station.offer.travel:
            continue
        low, high = station.offer.travel[name]
        window = settle.window(axis)
        check_travel(
            group, {axis: getattr(reading, axis)}, {name: (low - window, high + window)}
        )


def _not_there(group: str, away: dict[str, float], after_s: float) -> str:
    """Return what is wrong with a motion that should have ended."""
    if not away:
        return f"{group} still says that it moves after {after_s:.3g} s"
    off = ", ".join(f"{axis} by {value:.4g}" for axis, value in away.items())
    return f"{group} is off its target after {after_s:.3g} s: {off}"
