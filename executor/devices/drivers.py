"""Driver contracts: what the executor asks of hardware, by role.

A driver moves its device to absolute states and returns its readings; it decides
nothing. Limits, steps, settling, timeouts and stops are the executor's, in
`microplan.executor.motion.motion`. No two calls overlap but `stop`, which may come from
another thread at any time, also twice, also at rest. A driver raises what it likes when
its device fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from microplan.schemas.plan import Region

Counts = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisReading:
    """Absolute readings of one axis group."""

    x_um: float
    y_um: float
    z_um: float
    theta_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """An exposure: counts (rows, columns), and when it began on the station's clock."""

    counts: Counts
    exposed_s: float


class Device(Protocol):
    """Identity of a device."""

    @property
    def model(self) -> str:
        """Return maker and type."""
        ...

    @property
    def serial(self) -> str:
        """Return what distinguishes this device from another of its model."""
        ...


class Mover(Device, Protocol):
    """A device with something that moves."""

    def moving(self) -> bool:
        """Return whether the device reports a motion under way."""
        ...

    def stop(self) -> None:
        """Stop all motion at once, where it is; thread-safe, and harmless at rest."""
        ...


class Axes(Mover, Protocol):
    """A stage or robot."""

    def start(
        self,
        *,
        x_um: float | None = None,
        y_um: float | None = None,
        z_um: float | None = None,
        theta_rad: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> None:
        """Begin to go to absolute readings together, and return; None leaves an axis.

        Raises
        ------
        ValueError
            If a target is not finite or beyond what the device can reach; nothing
            moves then.
        """
        ...

    def reading(self) -> AxisReading:
        """Return the axes' present readings, moving or not."""
        ...


class Gripper(Mover, Protocol):
    """Jaws."""

    def start(self, opening_um: float) -> None:
        """Begin to open or close to `opening_um` between the jaws, and return.

        Raises
        ------
        ValueError
            As `Axes.start`.
        """
        ...

    def reading(self) -> float:
        """Return the drive's present reading of the opening, um."""
        ...


class Lens(Mover, Protocol):
    """Zoom and focus drives."""

    def start_magnification(self, magnification: float) -> None:
        """Begin to zoom, object to sensor; ValueError as `Axes.start`."""
        ...

    def start_focus_um(self, focus_um: float) -> None:
        """Begin to put the plane in focus at a world height; ValueError as above."""
        ...

    def reading(self) -> tuple[float, float]:
        """Return the drives' present readings of magnification and focus (um)."""
        ...


class Light(Device, Protocol):
    """The light source."""

    def set_level(self, level: float) -> None:
        """Set the brightness; 1 is the level the plan calls full."""
        ...


class Camera(Device, Protocol):
    """The camera."""

    def grab(self, region: Region | None = None, *, after_s: float) -> Frame:
        """Return `region`, or the whole frame, exposed at `after_s` or later.

        A camera that runs on its own discards older frames and waits for one. The
        executor refuses an older frame.

        Raises
        ------
        TimeoutError
            If no frame came; it is asked for again.
        """
        ...


class Clock(Protocol):
    """The station's time; the simulated cell's runs only while it is waited for."""

    def now_s(self) -> float:
        """Return seconds since the station started; never less than before."""
        ...

    def wait(self, seconds: float) -> None:
        """Let `seconds` pass."""
        ...
