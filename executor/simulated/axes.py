"""Axis groups of the simulated cell: every axis lands with a new error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.safety import AXES
from microplan.executor.simulated.contact import touch
from microplan.executor.simulated.timeline import DeviceFaults, Timeline
from microplan.executor.simulated.truth import AxisState, repeatability

STEP_UM = {"x_um": 4.0, "y_um": 4.0, "z_um": 1.0}  # between contact tests
STEP_RAD = 0.02  # 2 um at 100 um from the axis
SLIP = 0.1  # of the distance: how far an axis that slips moves along


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveError:
    """Errors of a drive against one that is where it reads; 0 is none."""

    quantum_um: float = 0.0  # targets and readings are multiples of it
    quantum_rad: float = 0.0
    backlash_um: float = 0.0  # lost on x, y and z when the direction reverses
    lag_s: float = 0.0  # the reading follows so much later

    def rounded(self, axis: str, value: float) -> float:
        """Return the nearest value that the drive can go to."""
        quantum = self.quantum_rad if axis == "theta_rad" else self.quantum_um
        return quantum * round(value / quantum) if quantum else value

    def slack(self, axis: str, distance: float) -> float:
        """Return the backlash after a motion by `distance`, um."""
        if axis == "theta_rad" or not distance:
            return 0.0
        return -math.copysign(self.backlash_um / 2, distance)


_Ends = dict[str, tuple[float, float, float]]  # by axis: command, true position, error


@dataclass(slots=True, kw_only=True)
class _Motion:
    """Motion in small steps, from old to new commands and true positions."""

    began_s: float
    seconds: float
    count: int
    old: _Ends
    new: _Ends
    taken: int = 0
    halt: int | None = None  # the step after which nothing more happens


class SimAxes:
    """A stage or robot; its faults begin with `axis_`."""

    def __init__(
        self,
        timeline: Timeline,
        name: str,
        state: AxisState,
        rng: np.random.Generator,
        trouble: DeviceFaults,
        *,
        drive: DriveError | None = None,
    ) -> None:
        self._timeline = timeline
        self._name = name
        self.model, self.serial = f"simulated {name}", f"sim-{name}"
        self._state = state
        self._rng = rng
        self._trouble = trouble
        self._drive = drive or DriveError()
        self._motion: _Motion | None = None
        timeline.add(self)

    def start(
        self,
        *,
        x_um: float | None = None,
        y_um: float | None = None,
        z_um: float | None = None,
        theta_rad: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> None:
        """Begin to go to absolute readings; see `drivers.Axes`."""
        asked = {"x_um": x_um, "y_um": y_um, "z_um": z_um, "theta_rad": theta_rad}
        self._check(asked)
        self._trouble.refuse("raises")
        self.stop()
        wanted = {
            name: self._drive.rounded(name, value)
            for name, value in asked.items()
            if value is not None
        }
        now = self._state.commanded
        target = {k: v for k, v in wanted.items() if v != now[k]}
        if target:
            with self._timeline.lock:
                self._motion = self._planned(target, speed_um_per_s)
        self._timeline.changed()

    def move(self, **targets: float) -> None:
        """Start a motion and let the cell's time pass until it has ended."""
        self.start(**targets)
        if not self.moving():
            return
        self._timeline.run_out(self)
        self._timeline.advance(self._state.spec.settle_s)

    def reading(self) -> AxisReading:
        """Return the commanded reading: the errors are not seen by the encoders."""
        motion = self._motion
        if motion is None:
            return AxisReading(**self._state.commanded)
        self._trouble.hang("hangs")
        now_s = self._timeline.truth.time_s - self._drive.lag_s
        share = min(max((now_s - motion.began_s) / max(motion.seconds, 1e-9), 0.0), 1.0)
        if motion.halt is not None:
            share = min(share, motion.halt / motion.count)
        shown = dict(self._state.commanded)
        for axis, (old, _, _) in motion.old.items():
            shown[axis] = old + share * (motion.new[axis][0] - old)
            shown[axis] = self._drive.rounded(axis, shown[axis])
        if self._trouble.on("nan"):
            shown[next(iter(motion.new))] = math.nan
        return AxisReading(**shown)

    def moving(self) -> bool:
        """Return whether a motion is under way."""
        return self._motion is not None

    def stop(self) -> None:
        """Stay where the axes are now."""
        self._trouble.free()
        with self._timeline.lock:
            halted, self._motion = self._motion is not None, None
        if halted:
            self._timeline.changed()

    def state(self) -> dict[str, Any]:
        """Return commands, true positions, errors and the motion under way."""
        now, motion = self._state, self._motion
        return {
            "commanded": now.commanded,
            "actual": now.actual,
            "error": now.error,
            "motion": None if motion is None else asdict(motion),
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Be where `state` says."""
        now, motion = self._state, data["motion"]
        now.commanded, now.actual = dict(data["commanded"]), dict(data["actual"])
        now.error = dict(data["error"])
        self._motion = None if motion is None else _Motion(**motion)

    def due_s(self) -> float:
        """Return when the next small step is due."""
        motion = self._motion
        if motion is None or motion.taken == motion.halt:
            return math.inf
        if motion.taken < motion.count:
            return motion.began_s + (motion.taken + 1) / motion.count * motion.seconds
        if self._trouble.on("never_ready"):
            return math.inf
        return motion.began_s + motion.seconds + self._drive.lag_s

    def step(self) -> None:
        """Take a small step and let things touch; after the last, be at rest."""
        motion = self._motion
        if motion is None:
            return
        if motion.taken < motion.count:
            motion.taken += 1
            self._place(motion)
            touch(self._timeline.truth, lambda: self._trouble.faults.on("block"))
        lagging = self._drive.lag_s > 0 and self.due_s() > self._timeline.truth.time_s
        at_end = motion.taken == motion.count and not lagging
        short = motion.taken == motion.halt and self._trouble.on("short")
        if short or (at_end and not self._trouble.on("never_ready")):
            self._motion = None

    def _check(self, asked: Mapping[str, float | None]) -> None:
        """Refuse a target that is not finite or beyond the axes' limits."""
        for name, value in asked.items():
            low, high = self._state.spec.limits.get(name, (-math.inf, math.inf))
            if value is not None and not (
                math.isfinite(value) and low <= value <= high
            ):
                raise ValueError(
                    f"{self._name}.{name} = {value:.6g} is outside {low:g}..{high:g}"
                )

    def _planned(
        self, target: Mapping[str, float], speed_um_per_s: float | None
    ) -> _Motion:
        """Return the motion to a target, with the errors it will land with."""
        state = self._state
        old = {
            k: (state.commanded[k], state.actual[k], state.error[k])
            for k in AXES
            if k in target
        }
        new = {}
        for name, value in target.items():
            error, meant = self._draw(name), value
            away = value - state.commanded[name]
            if self._trouble.on("wrong_way"):
                meant = state.commanded[name] - away
            slack = self._drive.slack(name, meant - state.commanded[name])
            true = meant + error + slack
            is_stage_x = name == "x_um" and self._name == "stage"
            if is_stage_x and self._trouble.faults.on("reversed_axis"):
                true = state.actual[name] - (true - state.actual[name])
            new[name] = (meant, true, error)
        if self._trouble.on("slips"):
            self._slip(old, new)
        # so many small steps keep every axis below its own
        steps = (abs(new[a][0] - old[a][1]) / STEP_UM.get(a, STEP_RAD) for a in new)
        count = math.ceil(max(steps)) + 1
        halted = self._trouble.on("stalls") or self._trouble.on("short")
        return _Motion(
            began_s=self._timeline.truth.time_s,
            seconds=self._seconds(target, speed_um_per_s),
            count=count,
            old=old,
            new=new,
            halt=count // 2 if halted else None,
        )

    def _slip(self, old: _Ends, new: _Ends) -> None:
        """Take an axis along that was not ordered to move."""
        axis = next(name for name in AXES if name not in new)
        by = max(abs(new[a][0] - old[a][0]) for a in new)
        state = self._state
        old[axis] = (state.commanded[axis], state.actual[axis], state.error[axis])
        new[axis] = (old[axis][0] + SLIP * by, old[axis][1] + SLIP * by, old[axis][2])

    def _draw(self, name: str) -> float:
        """Return a new repeatability error of one axis."""
        sigma = repeatability(self._state.spec)[AXES.index(name)]
        return float(sigma * self._rng.standard_normal())

    def _seconds(
        self, target: Mapping[str, float], speed_um_per_s: float | None
    ) -> float:
        """Return how long the slowest axis takes, settling left out."""
        spec = self._state.spec
        away = {k: abs(v - self._state.commanded[k]) for k, v in target.items()}
        across = math.hypot(away.get("x_um", 0.0), away.get("y_um", 0.0))
        return max(
            across / (speed_um_per_s or spec.speed_xy_um_per_s),
            away.get("z_um", 0.0) / (speed_um_per_s or spec.speed_z_um_per_s),
            away.get("theta_rad", 0.0) / spec.speed_theta_rad_per_s,
        )

    def _place(self, motion: _Motion) -> None:
        """Put the truth where it is after the steps taken."""
        state, share = self._state, motion.taken / motion.count
        for name, (command, actual, error) in motion.old.items():
            end = motion.new[name]
            state.commanded[name] = command + share * (end[0] - command)
            state.actual[name] = actual + share * (end[1] - actual)
            state.error[name] = error + share * (end[2] - error)
            if motion.taken == motion.count:  # exactly, whatever the sums round to
                state.commanded[name], state.actual[name], state.error[name] = end
