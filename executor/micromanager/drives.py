"""Micro-Manager devices as drives: numbers in the executor's units, with limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

Interval = tuple[float, float]
_SLACK = 1e-5  # relative: a plan's numbers carry six digits
_EVERYWHERE = (-math.inf, math.inf)


class Drive(Protocol):
    """What moves one number, or x and y together; values are as in the plan."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return what it moves, "x_um" and so on."""
        ...

    @property
    def label(self) -> str:
        """Return the device's label."""
        ...

    def check(self, targets: Mapping[str, float]) -> None:
        """Raise ValueError for a target that is not finite, or out of reach."""
        ...

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to go to checked targets, and return."""
        ...

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion, unit/s; None is the drive's own.

        Raises
        ------
        ValueError
            If it cannot be had.
        """
        ...

    def read(self) -> dict[str, float]:
        """Return where it is now."""
        ...

    def busy(self) -> bool:
        """Return whether it says that it moves."""
        ...

    def stop(self) -> None:
        """Stop where it is; from any thread."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """What a device's own number means: value = zero + per * number."""

    zero: float = 0.0
    per: float = 1.0

    def value(self, number: float) -> float:
        """Return the executor's value of a device's number."""
        return self.zero + self.per * number

    def number(self, value: float) -> float:
        """Return the device's number for a value."""
        return (value - self.zero) / self.per


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """How a device's speed is set; without a `name` it always has its `own_per_s`."""

    own_per_s: float
    name: str = ""  # a property of the device
    per: float = 1.0  # the property's number at one unit/s

    def order(self, core: CMMCorePlus, label: str, per_s: float | None) -> None:
        """Set the property; ValueError if a slower motion cannot be ordered."""
        if self.name:
            wanted = self.own_per_s if per_s is None else min(per_s, self.own_per_s)
            core.setProperty(label, self.name, wanted * self.per)
        elif per_s is not None and per_s < self.own_per_s * (1 - _SLACK):
            raise ValueError(
                f"{label} goes at {self.own_per_s:g}/s and cannot be slowed down to "
                f"{per_s:g}/s: state its speed property, or pace it"
            )


class StageDrive:
    """A single-axis stage device."""

    def __init__(
        self,
        core: CMMCorePlus,
        label: str,
        name: str,
        *,
        limits: Interval,
        scale: Scale,
        speed: Speed,
    ) -> None:
        self._core, self.label, self._name = core, label, name
        self._limits, self._scale, self._speed = limits, scale, speed

    @property
    def names(self) -> tuple[str, ...]:
        """Return what it moves."""
        return (self._name,)

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what is not finite or beyond the limits."""
        check_limits(self.label, targets, {self._name: self._limits})

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion."""
        self._speed.order(self._core, self.label, per_s)

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to move."""
        self._core.setPosition(self.label, self._scale.number(targets[self._name]))

    def read(self) -> dict[str, float]:
        """Return where it is."""
        return {self._name: self._scale.value(self._core.getPosition(self.label))}

    def busy(self) -> bool:
        """Return whether it says that it moves."""
        return bool(self._core.deviceBusy(self.label))

    def stop(self) -> None:
        """Stop."""
        self._core.stop(self.label)


class XYDrive:
    """An XY stage device: both axes go together.

    An axis that is left out is sent again to where it was last sent, not to where it
    reads: a device that rounds would creep by a step with every order.
    """

    names = ("x_um", "y_um")

    def __init__(
        self,
        core: CMMCorePlus,
        label: str,
        *,
        limits: Mapping[str, Interval],
        scales: Mapping[str, Scale],
        speed: Speed,
        hold_um: float,
    ) -> None:
        self._core, self.label = core, label
        self._limits, self._scales, self._speed = limits, scales, speed
        self._hold_um = hold_um  # a reading farther from the last order replaces it
        self._sent: dict[str, float] = {}

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what is not finite or beyond the limits."""
        check_limits(self.label, targets, self._limits)

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion."""
        self._speed.order(self._core, self.label, per_s)

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to move."""
        self._sent = {**self._held(), **targets}
        x, y = (self._scales[n].number(self._sent[n]) for n in self.names)
        self._core.setXYPosition(self.label, x, y)

    def read(self) -> dict[str, float]:
        """Return where it is."""
        found = self._core.getXYPosition(self.label)
        return {
            name: self._scales[name].value(number)
            for name, number in zip(self.names, found, strict=True)
        }

    def busy(self) -> bool:
        """Return whether it says that it moves."""
        return bool(self._core.deviceBusy(self.label))

    def stop(self) -> None:
        """Stop."""
        self._core.stop(self.label)

    def _held(self) -> dict[str, float]:
        """Return where both axes are to stay: the last order, if they are at it."""
        now = self.read()
        return {
            name: self._sent[name]
            if abs(self._sent.get(name, math.inf) - value) <= self._hold_um
            else value
            for name, value in now.items()
        }


class PropertyDrive:
    """A number that is a property of a device; it cannot be stopped under way."""

    def __init__(
        self,
        core: CMMCorePlus,
        label: str,
        property_name: str,
        name: str,
        *,
        limits: Interval,
        scale: Scale,
        speed: Speed,
    ) -> None:
        self._core, self.label, self._name = core, label, name
        self._property, self._scale, self._speed = property_name, scale, speed
        self._limits = limits
        check_property(core, label, property_name)

    @property
    def names(self) -> tuple[str, ...]:
        """Return what it moves."""
        return (self._name,)

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what is beyond the limits of the file or of the property."""
        check_limits(self.label, targets, {self._name: self._limits})
        number = {self._property: self._scale.number(targets[self._name])}
        own = property_limits(self._core, self.label, self._property)
        check_limits(self.label, number, {self._property: own})

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion."""
        self._speed.order(self._core, self.label, per_s)

    def go(self, targets: Mapping[str, float]) -> None:
        """Set the property."""
        number = self._scale.number(targets[self._name])
        self._core.setProperty(self.label, self._property, number)

    def read(self) -> dict[str, float]:
        """Return what the property says."""
        number = float(self._core.getProperty(self.label, self._property))
        return {self._name: self._scale.value(number)}

    def busy(self) -> bool:
        """Return whether the device says that it is at work."""
        return bool(self._core.deviceBusy(self.label))

    def stop(self) -> None:
        """Do nothing: a property has no stop."""


class StateDrive:
    """Some values only, each a state of a state device, as on a turret.

    Micro-Manager cannot stop a state device; a change goes on to its end.
    """

    def __init__(
        self, core: CMMCorePlus, label: str, name: str, states: Mapping[float, int]
    ) -> None:
        self._core, self.label, self._name = core, label, name
        self._states = dict(states)
        self._values = {state: value for value, state in states.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """Return what it moves."""
        return (self._name,)

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse a value that is no state."""
        self._state(targets[self._name])

    def pace(self, per_s: float | None) -> None:
        """Refuse: a state has no speed."""
        if per_s is not None:
            raise ValueError(f"{self.label} is a state device and has no speed")

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to change the state."""
        self._core.setState(self.label, self._state(targets[self._name]))

    def read(self) -> dict[str, float]:
        """Return the value of the present state; RuntimeError if it has none."""
        state = self._core.getState(self.label)
        if state not in self._values:
            raise RuntimeError(f"{self.label} is in state {state}, which has no value")
        return {self._name: self._values[state]}

    def busy(self) -> bool:
        """Return whether the device says that it changes."""
        return bool(self._core.deviceBusy(self.label))

    def stop(self) -> None:
        """Do nothing: a state device has no stop."""

    def _state(self, value: float) -> int:
        """Return the state of a value."""
        for known, state in self._states.items():
            if math.isclose(known, value, rel_tol=_SLACK):
                return state
        known_values = ", ".join(f"{v:g}" for v in self._states)
        raise ValueError(f"{self.label} has no {value:g}, only {known_values}")


def check_limits(
    label: str, values: Mapping[str, float], limits: Mapping[str, Interval]
) -> None:
    """Raise ValueError if a value is not finite or beyond its limits."""
    for name, value in values.items():
        low, high = limits[name]
        slack = _SLACK * max(
            (abs(v) for v in (low, high) if math.isfinite(v)), default=0
        )
        if not (math.isfinite(value) and low - slack <= value <= high + slack):
            raise ValueError(
                f"{label}: {name} = {value:.6g} is outside {low:g}..{high:g}"
            )


def property_limits(core: CMMCorePlus, label: str, name: str) -> Interval:
    """Return the limits that Micro-Manager knows of a property."""
    if not core.hasPropertyLimits(label, name):
        return _EVERYWHERE
    return (
        core.getPropertyLowerLimit(label, name),
        core.getPropertyUpperLimit(label, name),
    )


def check_property(core: CMMCorePlus, label: str, name: str) -> None:
    """Raise ValueError unless a device has a property."""
    if not core.hasProperty(label, name):
        known = ", ".join(core.getDevicePropertyNames(label))
        raise ValueError(f"{label} has no property {name!r}, only {known}")
