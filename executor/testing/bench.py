"""Test bench of a driver: clock, safe steps, guarded calls."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from microplan.executor.devices.drivers import Clock
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.timeouts import Caller, WallClock

T = TypeVar("T")
STEPS = {
    "x_um": 50.0, "y_um": 50.0, "z_um": 20.0, "theta_rad": 0.01,
    "opening_um": 10.0, "magnification": 1.0, "focus_um": 10.0,
}  # fmt: skip
WINDOWS = {
    "x_um": 0.5, "y_um": 0.5, "z_um": 0.5, "theta_rad": 1e-3,
    "opening_um": 0.5, "magnification": 1e-2, "focus_um": 0.5,
}  # fmt: skip
BAD = (math.nan, math.inf, -math.inf)


class ConformanceError(AssertionError):
    """A driver does not do what `microplan.executor.devices.drivers` states."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """Bench of a driver's test: steps, windows and time limits.

    Steps go from where the device is, up and back; `beyond` holds a target outside
    the device's limits by the name of the argument, to see it refused.
    """

    clock: Clock = field(default_factory=WallClock)
    step: Mapping[str, float] = field(default_factory=lambda: STEPS)
    window: Mapping[str, float] = field(default_factory=lambda: WINDOWS)
    beyond: Mapping[str, float] = field(default_factory=dict)
    timeout_s: float = 20.0  # of a motion or frame, by the bench's clock
    call_s: float = 5.0  # of a call, by the machine's clock
    poll_s: float = 0.01
    caller: Caller = field(default_factory=Caller)

    def call(self, name: str, call: Callable[[], T]) -> T:
        """Return a device call's result; ConformanceError if it raises or hangs."""
        try:
            return self.caller.call(name, call, self.call_s)
        except ExecutorError as error:
            raise ConformanceError(str(error)) from error

    def refused(self, name: str, call: Callable[[], object]) -> None:
        """Make a call that must raise ValueError."""
        try:
            self.caller.call(name, call, self.call_s)
        except ExecutorError as error:
            if isinstance(error.__cause__, ValueError):
                return
            raise ConformanceError(f"{name} must raise ValueError: {error}") from error
        raise ConformanceError(f"{name} must raise ValueError and was accepted")

    def rest(self, device: Any) -> None:
        """Wait until a device reports no motion."""
        began_s = self.clock.now_s()
        while self.call("moving", device.moving):
            if self.clock.now_s() - began_s > self.timeout_s:
                raise ConformanceError(f"it still moves after {self.timeout_s:g} s")
            self.clock.wait(self.poll_s)


Check = Callable[[Any, Bench], None]


def must(holds: bool, message: str) -> None:  # noqa: FBT001 - reads as a sentence
    """Raise ConformanceError unless `holds`."""
    if not holds:
        raise ConformanceError(message)


def identity(device: Any, bench: Bench) -> None:
    """Say maker and type, and a number."""
    for name in ("model", "serial"):
        found = bench.call(name, lambda name=name: getattr(device, name))  # type: ignore[misc]  # a bound name
        must(isinstance(found, str) and found != "", f"{name} is {found!r}")
