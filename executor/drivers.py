"""What the executor asks of hardware; the simulated cell is one such set of drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from schemas.plan import Region

Counts = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisReading:
    """Absolute readings of one axis group."""

    x_um: float
    y_um: float
    z_um: float
    theta_rad: float


class Axes(Protocol):
    """A stage or robot; `move` blocks until all motion has settled."""

    def move(
        self,
        *,
        x_um: float | None = None,
        y_um: float | None = None,
        z_um: float | None = None,
        theta_rad: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> None:
        """Go to absolute readings together; None leaves an axis.

        Raises
        ------
        ExecutorError
            MP840 if a target is beyond the limits; MP841 if the device fails.
        """
        ...

    def reading(self) -> AxisReading:
        """Return where the axes say they are."""
        ...

    def stop(self) -> None:
        """Stop all motion at once."""
        ...


class Gripper(Protocol):
    """Jaws; `move` blocks until they stand still."""

    def move(self, opening_um: float) -> None:
        """Open or close to `opening_um` between the jaws."""
        ...

    def reading(self) -> float:
        """Return the opening the drive says it has, um."""
        ...


class Lens(Protocol):
    """Zoom and focus drives."""

    def set_magnification(self, magnification: float) -> None:
        """Zoom, object to sensor."""
        ...

    def set_focus_um(self, focus_um: float) -> None:
        """Put the plane in focus at a world height."""
        ...


class Light(Protocol):
    """The light source."""

    def set_level(self, level: float) -> None:
        """Set the brightness; 1 is the level the plan calls full."""
        ...


class Camera(Protocol):
    """The camera; a frame is exposed after all motion has settled."""

    def grab(self, region: Region | None = None) -> Counts:
        """Return counts (rows, columns) of `region`, or of the whole frame."""
        ...


class Clock(Protocol):
    """Time for the log; the simulated cell's runs on its own."""

    def now_s(self) -> float:
        """Return seconds since the station started."""
        ...
