"""The bench a driver is tested on: clock, safe steps, and how checks are run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from executor.calls import Caller
from executor.drivers import Clock
from executor.errors import ExecutorError
from executor.loading import ROLES, check_role
from executor.wall_clock import WallClock

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
    """A driver does not do what `executor.drivers` says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """How far a device may be moved for a test, and how long it may take.

    Steps go from where the device stands, up and back; `beyond` holds a target outside
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
        """Return what a device call returns; ConformanceError if it raises or hangs."""
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
        """Wait until a device says that it stands."""
        began_s = self.clock.now_s()
        while self.call("moving", device.moving):
            if self.clock.now_s() - began_s > self.timeout_s:
                raise ConformanceError(f"it still moves after {self.timeout_s:g} s")
            self.clock.wait(self.poll_s)


Check = Callable[[Any, Bench], None]


@dataclass(frozen=True, slots=True)
class Result:
    """One check: its name, and what is wrong; "" if nothing is."""

    check: str
    wrong: str


def must(holds: bool, message: str) -> None:  # noqa: FBT001 - reads as a sentence
    """Raise ConformanceError unless `holds`."""
    if not holds:
        raise ConformanceError(message)


def identity(device: Any, bench: Bench) -> None:
    """Say maker and type, and a number."""
    for name in ("model", "serial"):
        found = bench.call(name, lambda name=name: getattr(device, name))  # type: ignore[misc]  # a bound name
        must(isinstance(found, str) and found != "", f"{name} is {found!r}")


def checks(role: str) -> Mapping[str, Check]:
    """Return the checks of a role by name."""
    from executor.testing.others import CAMERA, CLOCK, LIGHT  # they use this bench
    from executor.testing.movers import AXES, JAWS, LENS  # isort: skip

    found = {
        "stage": AXES, "robot": AXES, "jaws": JAWS, "lens": LENS, "light": LIGHT,
        "camera": CAMERA, "clock": CLOCK,
    }  # fmt: skip
    if role not in found:
        raise ValueError(f"no role {role!r}, known: {', '.join(ROLES)}")
    return found[role]


def results(device: Any, role: str, bench: Bench) -> Iterator[Result]:
    """Yield one result a check; a device that lacks methods gets no further."""
    try:
        check_role(device, role, role)
    except ExecutorError as error:
        yield Result("has all methods", error.message)
        return
    for name, check in checks(role).items():
        try:
            check(device, bench)
        except ConformanceError as error:
            yield Result(name, str(error))
        else:
            yield Result(name, "")
        finally:
            if hasattr(device, "stop"):
                device.stop()


def failures(device: Any, role: str, bench: Bench) -> tuple[Result, ...]:
    """Return the checks that a driver fails."""
    return tuple(r for r in results(device, role, bench) if r.wrong)


def conforms(device: Any, role: str, bench: Bench) -> None:
    """Raise ConformanceError with all that is wrong with a driver; for a test."""
    wrong = [f"{r.check}: {r.wrong}" for r in failures(device, role, bench)]
    must(not wrong, "; ".join(wrong))
