"""Rendered camera for Micro-Manager: a plan's scene where the devices are.

For a core that takes devices written in Python, `UniMMCore` of pymmcore-plus. The
picture is the simulated cell's: its own defocus model, noise, and drawn errors.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from pymmcore_plus.experimental.unicore import SimpleCameraDevice

from microplan.executor.devices.drivers import AxisReading, Counts

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

    from microplan.executor.simulated.cell import Cell
    from microplan.executor.simulated.following import DeviceReadings


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Labels of the core's devices that the picture follows; "": none, it stays.

    All are read in um as they are; `magnification` is where the zoom stays.
    """

    xy: str = ""
    z: str = ""
    focus: str = ""
    magnification: float | None = None

    def readings(self, core: CMMCorePlus, start: AxisReading) -> DeviceReadings:
        """Return the readings of a core's devices."""
        from microplan.executor.simulated.following import DeviceReadings

        x_um, y_um = (
            core.getXYPosition(self.xy) if self.xy else (start.x_um, start.y_um)
        )
        return DeviceReadings(
            stage=AxisReading(
                x_um=x_um,
                y_um=y_um,
                z_um=core.getPosition(self.z) if self.z else start.z_um,
                theta_rad=start.theta_rad,
            ),
            focus_um=core.getPosition(self.focus) if self.focus else None,
            magnification=self.magnification,
        )


class RenderedCamera(SimpleCameraDevice):
    """A camera that renders a simulated cell.

    Parameters
    ----------
    cell : Cell
        What it shows.
    lead : callable
        Brings the cell to where the core's devices are; called before each picture.
    """

    def __init__(self, cell: Cell, lead: Callable[[], None]) -> None:
        super().__init__()
        self._cell, self._lead = cell, lead
        self._exposure_ms = 1000 * cell.truth.world.optics.frame_time_s

    @classmethod
    def of_plan(
        cls, plan_folder: Path, core: CMMCorePlus, labels: Labels, *, seed: int = 0
    ) -> RenderedCamera:
        """Return the camera of a plan folder's world.json, for `core.loadPyDevice`.

        Raises
        ------
        ExecutorError
            MP803 if the world cannot be read; MP816 for light that is not shown.
        """
        from microplan.executor.simulated.cell import build_cell  # loads the renderer
        from microplan.executor.simulated.following import follow
        from microplan.executor.simulated.hub import read_world

        cell = build_cell(read_world(plan_folder / "world.json"), seed)
        start, began_s = cell.stage.reading(), time.monotonic()
        found = weakref.ref(core)  # the core has the camera: no ring of the two

        def lead() -> None:
            core = found()
            if core is not None:
                follow(cell, labels.readings(core, start), time.monotonic() - began_s)

        return cls(cell, lead)

    def sensor_shape(self) -> tuple[int, int]:
        """Return rows and columns."""
        optics = self._cell.truth.world.optics
        return (optics.height_px, optics.width_px)

    def dtype(self) -> npt.DTypeLike:
        """Return the type of a count."""
        return np.uint8 if self._cell.truth.world.optics.bits <= 8 else np.uint16

    def get_exposure(self) -> float:
        """Return the exposure time, ms."""
        return self._exposure_ms

    def set_exposure(self, exposure: float) -> None:
        """Note an exposure time, ms; the brightness is the light's."""
        self._exposure_ms = exposure

    def snap(self, buffer: Counts) -> Mapping[str, Any]:
        """Lead the cell to where the devices are, and draw it."""
        with self._cell.timeline.lock:
            self._lead()
            buffer[:] = self._cell.camera.grab(None).counts
        return {}
