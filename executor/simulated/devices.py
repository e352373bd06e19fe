"""Drivers of the simulated cell: they move the truth, with its errors and its time."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from executor.drivers import AxisReading
from executor.errors import ExecutorError
from executor.simulated.contact import touch
from executor.simulated.jaws import close_jaws, open_jaws
from executor.simulated.truth import AxisState, Truth

STEP_UM = {"x_um": 4.0, "y_um": 4.0, "z_um": 1.0}  # between contact tests
STEP_RAD = 0.02  # 2 um at 100 um from the axis
JAW_TIME_S = 0.3  # the workcell states none


class SimClock:
    """The cell's own time."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def now_s(self) -> float:
        """Return seconds since the cell was built."""
        return self._truth.time_s


class SimAxes:
    """A stage or robot: every commanded axis lands with a new error."""

    def __init__(
        self,
        truth: Truth,
        name: str,
        state: AxisState,
        rng: np.random.Generator,
        *,
        block: bool = False,
    ) -> None:
        self._truth = truth
        self._name = name
        self._state = state
        self._rng = rng
        self._block = block

    def move(
        self,
        *,
        x_um: float | None = None,
        y_um: float | None = None,
        z_um: float | None = None,
        theta_rad: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> None:
        """Go to absolute readings; see `executor.drivers.Axes`."""
        asked = {"x_um": x_um, "y_um": y_um, "z_um": z_um, "theta_rad": theta_rad}
        now = self._state.commanded
        target = {k: v for k, v in asked.items() if v is not None and v != now[k]}
        self._check_limits(target)
        errors = {name: self._draw(name) for name in target}
        seconds = self._seconds(target, speed_um_per_s)
        self._travel(target, errors, seconds)
        self._truth.time_s += self._state.spec.settle_s if target else 0.0

    def reading(self) -> AxisReading:
        """Return the commanded reading: the errors are not seen by the encoders."""
        return AxisReading(**self._state.commanded)

    def stop(self) -> None:
        """Do nothing: moves block, so nothing is under way."""

    def _check_limits(self, target: Mapping[str, float]) -> None:
        """Refuse a target beyond the axes' limits."""
        for name, value in target.items():
            low, high = self._state.spec.limits.get(name, (-math.inf, math.inf))
            if not low <= value <= high:
                raise ExecutorError(
                    "MP840",
                    f"{self._name}.{name} = {value:.6g} is outside {low:g}..{high:g}",
                )

    def _draw(self, name: str) -> float:
        """Return a new repeatability error of one axis."""
        spec = self._state.spec
        sigma = {
            "x_um": spec.repeatability_xy_um,
            "y_um": spec.repeatability_xy_um,
            "z_um": spec.repeatability_z_um,
            "theta_rad": spec.repeatability_theta_rad,
        }[name]
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

    def _travel(
        self, target: Mapping[str, float], errors: Mapping[str, float], seconds: float
    ) -> None:
        """Move in small steps and let things touch after each."""
        state, truth = self._state, self._truth
        state.commanded.update(target)
        old = {name: (state.actual[name], state.error[name]) for name in target}
        began_s, count = truth.time_s, self._count(target)
        for i in range(1, count + 1):
            share = i / count
            truth.time_s = began_s + share * seconds
            for name, value in target.items():
                actual, error = old[name]
                end = value + errors[name]
                state.actual[name] = actual + share * (end - actual)
                state.error[name] = error + share * (errors[name] - error)
            touch(truth, block=self._block)

    def _count(self, target: Mapping[str, float]) -> int:
        """Return how many small steps keep every axis below its step."""
        steps = [
            abs(value - self._state.actual[name]) / STEP_UM.get(name, STEP_RAD)
            for name, value in target.items()
        ]
        return math.ceil(max(steps, default=0.0)) + bool(target)


class SimGripper:
    """Jaws; `stick` is the chance that a released part follows a finger."""

    def __init__(
        self, truth: Truth, rng: np.random.Generator, *, stick: float = 0.0
    ) -> None:
        self._truth = truth
        self._rng = rng
        self._stick = stick
        self._commanded = truth.opening_um

    def move(self, opening_um: float) -> None:
        """Open or close; see `executor.drivers.Gripper`."""
        tool = self._truth.tool
        if tool is None:
            raise ExecutorError("MP841", "there are no jaws")
        low, high = tool.opening_um
        if not low <= opening_um <= high:
            raise ExecutorError(
                "MP840", f"opening {opening_um:g} um is outside {low:g}..{high:g} um"
            )
        if opening_um < self._truth.opening_um:
            close_jaws(self._truth, opening_um)
        else:
            sticks, side = self._rng.random(2)
            stuck = float(np.sign(side - 0.5)) if sticks < self._stick else 0.0
            open_jaws(self._truth, opening_um, stick_side=stuck)
        self._commanded = opening_um
        self._truth.time_s += JAW_TIME_S
        touch(self._truth)

    def reading(self) -> float:
        """Return the commanded opening: the drive does not feel what it holds."""
        return self._commanded
