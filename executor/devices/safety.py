"""Safety rules of motion: travel, step, speed, progress; no device is touched."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.plan import AxesName, AxisMove

Interval = tuple[float, float]
Phase = Literal["approach", "servo", "insert", "retreat"]

PHASES: tuple[Phase, ...] = ("approach", "servo", "insert", "retreat")
AXES = ("x_um", "y_um", "z_um", "theta_rad")
# Limits come from files in six digits: what is beyond by less is rounding.
ROUNDING = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Settle:
    """Criteria of an axis group's arrival: windows, dwell, timeout, stall."""

    window_um: float = 0.05  # reading to target; x, y and z each
    window_rad: float = 1e-5
    dwell_s: float = 0.15  # the reading stays inside so long
    timeout_s: float = 10.0  # beyond the time that distance and speed explain
    stall_s: float = 1.0  # without coming closer

    def window(self, axis: str) -> float:
        """Return the window of one axis, um or rad."""
        return self.window_rad if axis == "theta_rad" else self.window_um


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseLimit:
    """The largest step and the highest speed of one phase of work."""

    step_um: float = math.inf  # straight from the reading to the target
    step_rad: float = math.inf
    speed_um_per_s: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Safety:
    """The rules of one station, by phase where they differ.

    The fingers' underside, which is the robot's z, stays `fingers_above_stage_um`
    above the stage's surface, or at the surface in a phase of `close_phases`.
    """

    phases: Mapping[Phase, PhaseLimit] = field(default_factory=dict)
    fingers_above_stage_um: float = 0.0
    close_phases: tuple[Phase, ...] = ("insert",)
    call_s: float = 5.0  # a device call may take so long
    grab_s: float = 60.0  # the camera's
    poll_s: float = 0.02  # between two readings of a moving axis

    def phase(self, name: Phase) -> PhaseLimit:
        """Return the limits of a phase; a phase without any has none."""
        return self.phases.get(name, PhaseLimit())


def targets(move: AxisMove) -> dict[str, float]:
    """Return the axes that a move names, with their targets."""
    named = {axis: getattr(move, axis) for axis in AXES}
    return {axis: value for axis, value in named.items() if value is not None}


def check_finite(name: str, values: Mapping[str, float]) -> None:
    """Raise MP847 if a value is nan or infinite."""
    for axis, value in values.items():
        if not math.isfinite(value):
            raise ExecutorError("MP847", f"{name}.{axis} is {value}")


def check_opening(opening_um: float, within_um: Interval | None) -> None:
    """Raise MP847 or MP840 for an opening that is none; None: no limits are known."""
    check_finite("jaws", {"opening_um": opening_um})
    if within_um is not None:
        travel = {"jaws.opening_um": within_um}
        check_travel("jaws", {"opening_um": opening_um}, travel)


def check_travel(
    group: str, values: Mapping[str, float], travel: Mapping[str, Interval]
) -> None:
    """Raise MP840 if an axis would leave its travel, or has none."""
    for axis, value in values.items():
        name = f"{group}.{axis}"
        if name not in travel:
            raise ExecutorError("MP840", f"the station has no axis {name}")
        low, high = travel[name]
        slack = ROUNDING * max(abs(low), abs(high))
        if not low - slack <= value <= high + slack:
            raise ExecutorError(
                "MP840", f"{name} = {value:.6g} is outside {low:g}..{high:g}"
            )


def check_step(
    move: AxisMove, now: AxisReading, phase: Phase, limit: PhaseLimit
) -> None:
    """Raise MP843 if a move is longer, rotates more or is faster than its phase may.

    So does a speed that leads nowhere.
    """
    if move.speed_um_per_s is not None and not move.speed_um_per_s > 0:
        raise ExecutorError(
            "MP843",
            f"{move.axes}: speed of {move.speed_um_per_s:.6g} um/s in phase {phase}, "
            "must be positive",
        )
    away = {a: abs(v - getattr(now, a)) for a, v in targets(move).items()}
    turn_rad = away.pop("theta_rad", 0.0)
    found = (
        ("step", math.hypot(*away.values()), limit.step_um, "um"),
        ("turn", turn_rad, limit.step_rad, "rad"),
        ("speed", move.speed_um_per_s or 0.0, limit.speed_um_per_s, "um/s"),
    )
    for what, value, most, unit in found:
        if not value <= most * (1 + ROUNDING):
            raise ExecutorError(
                "MP843",
                f"{move.axes}: {what} of {value:.6g} {unit} in phase {phase}, at most "
                f"{most:g} {unit}",
            )


def check_fingers(
    fingers_z_um: float, surface_z_um: float, phase: Phase, safety: Safety
) -> None:
    """Raise MP842 if the fingers would come too close to the stage's surface."""
    margin_um = 0.0 if phase in safety.close_phases else safety.fingers_above_stage_um
    if fingers_z_um - surface_z_um < margin_um - ROUNDING * abs(surface_z_um):
        raise ExecutorError(
            "MP842",
            f"the fingers would be {fingers_z_um - surface_z_um:.6g} um above the "
            f"stage, at least {margin_um:g} um in phase {phase}",
        )


def outside(
    reading: AxisReading, target: Mapping[str, float], settle: Settle
) -> Iterator[tuple[str, float]]:
    """Yield (axis, distance) of every axis that is not in its window, um or rad."""
    for axis, value in target.items():
        away = abs(getattr(reading, axis) - value)
        if not away <= settle.window(axis):  # also if the reading is nan
            yield axis, away


class MotionProgress:
    """Watches one motion: axes must keep coming closer until all are in their windows.

    An axis with a short distance may creep while another goes far, where a controller
    lets all arrive together: a motion has stalled only if no axis has come closer.

    Parameters
    ----------
    start : AxisReading
        The reading before the motion.
    target : mapping of str to float
        Where it goes.
    settle : Settle
        Windows, and how long a motion may stall.
    """

    def __init__(
        self, start: AxisReading, target: Mapping[str, float], settle: Settle
    ) -> None:
        self._start, self._target, self._settle = start, dict(target), settle
        self._first = {a: abs(getattr(start, a) - v) for a, v in target.items()}
        self._best = dict(self._first)
        self._since_s: dict[str, float] = {}

    def check(self, group: str, reading: AxisReading, now_s: float) -> None:
        """Raise MP846 if an axis diverges, stalls, or moves without an order."""
        for axis in AXES:
            if axis not in self._target:
                self._check_still(group, axis, reading)
        away = dict(outside(reading, self._target, self._settle))
        for axis in self._target:
            if axis not in away:
                self._since_s.pop(axis, None)
            else:
                self._check_axis(group, axis, away[axis], now_s)
        if away:
            self._check_stall(group, away, now_s)

    def _check_still(self, group: str, axis: str, reading: AxisReading) -> None:
        """An axis without an order must not move.

        Two windows: one for the reading before, one for the reading now.
        """
        moved = abs(getattr(reading, axis) - getattr(self._start, axis))
        if not moved <= 2 * self._settle.window(axis):
            raise ExecutorError(
                "MP846", f"{group}.{axis} moved by {moved:.4g} and was not told to"
            )

    def _check_axis(self, group: str, axis: str, away: float, now_s: float) -> None:
        """One axis that has not arrived; `away` is how far it has to go."""
        settle, first = self._settle, self._first[axis]
        if away > first + 2 * settle.window(axis):
            raise ExecutorError(
                "MP846",
                f"{group}.{axis} goes the wrong way: {away:.4g} from its target, was "
                f"{first:.4g}",
            )
        # closer by less than a tenth of the window is the noise of the reading
        closer = away < self._best[axis] - settle.window(axis) / 10
        if closer or axis not in self._since_s:
            self._since_s[axis], self._best[axis] = now_s, away

    def _check_stall(self, group: str, away: Mapping[str, float], now_s: float) -> None:
        """Some axis must have come closer not long ago."""
        stood_s = now_s - max(self._since_s[axis] for axis in away)
        if stood_s > self._settle.stall_s:
            named = ", ".join(f"{group}.{a} {v:.4g}" for a, v in away.items())
            raise ExecutorError(
                "MP846",
                f"nothing has come closer for {stood_s:.3g} s; from their targets: "
                f"{named}",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """Own speeds of an axis group, where nothing slower is asked."""

    xy_um_per_s: float = math.inf
    z_um_per_s: float = math.inf
    theta_rad_per_s: float = math.inf

    def fastest(self, asked_um_per_s: float | None) -> float:
        """Return the higher speed of x, y and z, or what is asked instead."""
        return asked_um_per_s or max(self.xy_um_per_s, self.z_um_per_s)

    def seconds(self, away: Mapping[str, float], speed_um_per_s: float | None) -> float:
        """Return the time of the slowest axis for its distance, um or rad."""
        across = math.hypot(away.get("x_um", 0.0), away.get("y_um", 0.0))
        return max(
            across / (speed_um_per_s or self.xy_um_per_s),
            away.get("z_um", 0.0) / (speed_um_per_s or self.z_um_per_s),
            away.get("theta_rad", 0.0) / self.theta_rad_per_s,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """Rules of a station: settling, own speeds and safety limits of its devices."""

    stage: Settle = field(default_factory=Settle)
    robot: Settle = field(default_factory=Settle)
    stage_speeds: Speeds = field(default_factory=Speeds)
    robot_speeds: Speeds = field(default_factory=Speeds)
    stage_datum_z_um: float = 0.0  # world height of the stage's surface at reading 0
    jaws_window_um: float = 0.5
    focus_window_um: float = 0.1
    zoom_window: float = 1e-3  # relative
    drive_timeout_s: float = 20.0  # of jaws, zoom and focus
    safety: Safety = field(default_factory=Safety)

    def settle(self, group: AxesName) -> Settle:
        """Return when an axis group has arrived."""
        return self.stage if group == "stage" else self.robot

    def speeds(self, group: AxesName) -> Speeds:
        """Return the own speeds of an axis group."""
        return self.stage_speeds if group == "stage" else self.robot_speeds

    def speed(
        self, group: AxesName, phase: Phase, asked_um_per_s: float | None
    ) -> float | None:
        """Return the speed to order, None for the axes' own.

        The axes' own speed is lowered to the limit of the phase; one that was asked for
        is checked and kept.
        """
        limit, own = self.safety.phase(phase).speed_um_per_s, self.speeds(group)
        if asked_um_per_s is not None or own.fastest(None) <= limit:
            return asked_um_per_s
        if math.isinf(limit):
            return None
        return min(limit, own.xy_um_per_s, own.z_um_per_s)
