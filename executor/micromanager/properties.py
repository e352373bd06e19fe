"""Drives from Micro-Manager's properties or states, which cannot be stopped."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from microplan.executor.micromanager.drives import (
    SLACK,
    Interval,
    StageDrive,
    check_limits,
)

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

_EVERYWHERE = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class PropertyDrive(StageDrive):
    """A number that is a property of a device; it cannot be stopped under way."""

    property_name: str

    def __post_init__(self) -> None:
        check_property(self.core, self.label, self.property_name)

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what is beyond the limits of the file or of the property."""
        check_limits(self.label, targets, {self.name: self.limits})
        number = {self.property_name: self.scale.number(targets[self.name])}
        own = property_limits(self.core, self.label, self.property_name)
        check_limits(self.label, number, {self.property_name: own})

    def go(self, targets: Mapping[str, float]) -> None:
        """Set the property."""
        number = self.scale.number(targets[self.name])
        self.core.setProperty(self.label, self.property_name, number)

    def read(self) -> dict[str, float]:
        """Return the property's value."""
        number = float(self.core.getProperty(self.label, self.property_name))
        return {self.name: self.scale.value(number)}

    def stop(self) -> None:
        """Do nothing: a property has no stop."""


class StateDrive:
    """Drive of a state device, as a turret: some values only, a state each.

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
        """Return the names of its numbers."""
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
        """Return whether the device reports a change under way."""
        return bool(self._core.deviceBusy(self.label))

    def stop(self) -> None:
        """Do nothing: a state device has no stop."""

    def _state(self, value: float) -> int:
        """Return the state of a value."""
        for known, state in self._states.items():
            if math.isclose(known, value, rel_tol=SLACK):
                return state
        known_values = ", ".join(f"{v:g}" for v in self._states)
        raise ValueError(f"{self.label} has no {value:g}, only {known_values}")


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
