"""Moving devices of a station, composed of drives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.safety import AXES
from microplan.executor.micromanager.drives import Drive


class Moved:
    """Device of several drives that are ordered and stopped together."""

    def __init__(self, model: str, serial: str, drives: Sequence[Drive]) -> None:
        self.model, self.serial = model, serial
        self._drives = tuple(drives)
        self.names = tuple(name for drive in drives for name in drive.names)
        self._stops = 0

    def moving(self) -> bool:
        """Return whether a drive reports motion."""
        busy = [drive.busy() for drive in self._drives]  # all of them take a step
        return any(busy)

    def stop(self) -> None:
        """Stop all drives; one that cannot be stopped keeps no other from it."""
        self._stops += 1
        errors = []
        for drive in self._drives:
            try:
                drive.stop()
            except Exception as error:  # noqa: BLE001 - reported when all were asked
                errors.append(f"{drive.label}: {error}")
        if errors:
            raise RuntimeError("; ".join(errors))

    def order(
        self, targets: Mapping[str, float], speed_um_per_s: float | None = None
    ) -> None:
        """Check all targets, then begin to move; ValueError if one is refused.

        The speed is that of lengths, none of the angle's.
        A stop that comes meanwhile ends it: what was begun is stopped.
        """
        parts = self._parts(targets)
        for drive, wanted in parts:
            drive.check(wanted)
        for drive, wanted in parts:
            is_length = not wanted.keys().isdisjoint(AXES[:3])
            drive.pace(speed_um_per_s if is_length else None)
        stops = self._stops
        for drive, wanted in parts:
            if self._stops == stops:
                drive.go(wanted)
        if self._stops != stops:
            self.stop()

    def values(self) -> dict[str, float]:
        """Return the readings of all drives by name."""
        return {n: v for drive in self._drives for n, v in drive.read().items()}

    def _parts(
        self, targets: Mapping[str, float]
    ) -> list[tuple[Drive, dict[str, float]]]:
        """Return each drive that is meant, with its own targets."""
        for name in targets:
            if name not in self.names:
                raise ValueError(f"{self.serial} has no {name}")
        parts = [
            (drive, {n: targets[n] for n in drive.names if n in targets})
            for drive in self._drives
        ]
        return [part for part in parts if part[1]]


class MMAxes(Moved):
    """A stage or robot; an axis that no drive moves reads 0."""

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
        asked = dict(zip(AXES, (x_um, y_um, z_um, theta_rad), strict=True))
        targets = {name: value for name, value in asked.items() if value is not None}
        if speed_um_per_s is not None and not 0 < speed_um_per_s < math.inf:
            raise ValueError(f"{self.serial}: a speed of {speed_um_per_s:g} um/s")
        self.order(targets, speed_um_per_s)

    def reading(self) -> AxisReading:
        """Return the axes' readings."""
        return AxisReading(**{**dict.fromkeys(AXES, 0.0), **self.values()})


class MMGripper(Moved):
    """Jaws on one drive."""

    def start(self, opening_um: float) -> None:
        """Begin to open or close; see `microplan.executor.devices.drivers.Gripper`."""
        self.order({"opening_um": opening_um})

    def reading(self) -> float:
        """Return the drive's reading of the opening, um."""
        return self.values()["opening_um"]


class MMLens(Moved):
    """Zoom and focus, a drive each; a turret that is stopped goes on to its end."""

    def start_magnification(self, magnification: float) -> None:
        """Begin to zoom."""
        self.order({"magnification": magnification})

    def start_focus_um(self, focus_um: float) -> None:
        """Begin to focus."""
        self.order({"focus_um": focus_um})

    def reading(self) -> tuple[float, float]:
        """Return the drives' readings of magnification and focus (um)."""
        found = self.values()
        return (found["magnification"], found["focus_um"])
