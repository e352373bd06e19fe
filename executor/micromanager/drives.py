"""Drives from Micro-Manager's stages: the executor's units, with limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

Interval = tuple[float, float]
SLACK = 1e-5  # relative: a plan's numbers carry six digits


class Drive(Protocol):
    """Drive of one number, or of x and y together; values are as in the plan."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of its numbers, "x_um" and so on."""
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
        """Return its present values by name."""
        ...

    def busy(self) -> bool:
        """Return whether it reports motion."""
        ...

    def stop(self) -> None:
        """Stop where it is; from any thread."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceScale:
    """Scale of a device's own number: value = zero + per * number."""

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
    """Speed setting of a device; without a `name` it always has its `own_per_s`."""

    own_per_s: float
    name: str = ""  # a property of the device
    per: float = 1.0  # the property's number at one unit/s

    def order(self, core: CMMCorePlus, label: str, per_s: float | None) -> None:
        """Set the property; ValueError if a slower motion cannot be ordered."""
        if self.name:
            wanted = self.own_per_s if per_s is None else min(per_s, self.own_per_s)
            core.setProperty(label, self.name, wanted * self.per)
        elif per_s is not None and per_s < self.own_per_s * (1 - SLACK):
            raise ValueError(
                f"{label} goes at {self.own_per_s:g}/s and cannot be slowed down to "
                f"{per_s:g}/s: state its speed property, or pace it"
            )


@dataclass(frozen=True, slots=True)
class StageDrive:
    """A single-axis stage device; `name` is the number that it moves."""

    core: CMMCorePlus
    label: str
    name: str
    limits: Interval
    scale: DeviceScale
    speed: Speed

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of its numbers."""
        return (self.name,)

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what is not finite or beyond the limits."""
        check_limits(self.label, targets, {self.name: self.limits})

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion."""
        self.speed.order(self.core, self.label, per_s)

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to move."""
        self.core.setPosition(self.label, self.scale.number(targets[self.name]))

    def read(self) -> dict[str, float]:
        """Return its present values by name."""
        return {self.name: self.scale.value(self.core.getPosition(self.label))}

    def busy(self) -> bool:
        """Return whether it reports motion."""
        return bool(self.core.deviceBusy(self.label))

    def stop(self) -> None:
        """Stop."""
        self.core.stop(self.label)


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
        scales: Mapping[str, DeviceScale],
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
        """Return its present values by name."""
        found = self._core.getXYPosition(self.label)
        return {
            name: self._scales[name].value(number)
            for name, number in zip(self.names, found, strict=True)
        }

    def busy(self) -> bool:
        """Return whether it reports motion."""
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


def check_limits(
    label: str, values: Mapping[str, float], limits: Mapping[str, Interval]
) -> None:
    """Raise ValueError if a value is not finite or beyond its limits."""
    for name, value in values.items():
        low, high = limits[name]
        slack = SLACK * max(
            (abs(v) for v in (low, high) if math.isfinite(v)), default=0
        )
        if not (math.isfinite(value) and low - slack <= value <= high + slack):
            raise ValueError(
                f"{label}: {name} = {value:.6g} is outside {low:g}..{high:g}"
            )
