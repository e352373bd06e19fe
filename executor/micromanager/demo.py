"""A hub of Micro-Manager's demo devices around a simulated cell that follows them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from microplan.executor.devices.drivers import Mover
from microplan.executor.devices.tables import Table
from microplan.executor.devices.timeouts import WallClock
from microplan.executor.micromanager.hub import FILE, Hub, make_hub
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.following import DeviceReadings, follow
from microplan.executor.simulated.hub import read_world

ARRIVE_S = 30.0  # to the plan's start, for each device
POLL_S = 0.01
DEMO = ("DemoCamera", "SequenceTester", "Utilities")  # adapters without any hardware


class RenderedHub:
    """Micro-Manager's devices, and the cell that is where they are.

    Reading a device leads the cell to it: things touch while they move, not only
    in pictures. `judge`, `shown_um`, `faults` and `truth` are the cell's.
    """

    def __init__(self, found: Hub, cell: Cell) -> None:
        self.hub, self.cell = found, cell
        self._began_s = time.monotonic()
        self.clock: WallClock = found.clock
        self.light, self.camera = found.light, found.camera
        self.stage = _Led(found.stage, self) if found.stage else None
        self.robot = _Led(found.robot, self) if found.robot else None
        self.jaws = _Led(found.jaws, self) if found.jaws else None
        self.lens = _Led(found.lens, self) if found.lens else None
        self.judge, self.shown_um = cell.judge, cell.shown_um
        self.faults, self.truth = cell.faults, cell.truth

    def close(self) -> None:
        """Stop, unload and drain."""
        self.hub.close()

    def lead(self) -> None:
        """Bring the cell to where the devices are."""
        found = self.hub
        with self.cell.timeline.lock:
            opening_um = None
            if found.jaws is not None and not found.jaws.moving():
                opening_um = found.jaws.reading()
            zoom = None if found.lens is None or found.lens.moving() else found.lens
            magnification, focus_um = zoom.reading() if zoom else (None, None)
            readings = DeviceReadings(
                stage=found.stage.reading() if found.stage else None,
                robot=found.robot.reading() if found.robot else None,
                opening_um=opening_um,
                magnification=magnification,
                focus_um=focus_um,
                level=found.light.level if found.light else None,
            )
            follow(self.cell, readings, time.monotonic() - self._began_s)


class _Led:
    """A device whose readings lead the cell."""

    def __init__(self, device: Any, owner: RenderedHub) -> None:
        self._device, self._owner = device, owner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def reading(self) -> Any:
        """Return the device's reading, the cell brought to it."""
        found = self._device.reading()
        self._owner.lead()
        return found


def rendered_hub(*, world: str, seed: int = 0, **options: Any) -> RenderedHub:
    """Return demo devices brought to the world's start, and the cell behind them.

    Parameters
    ----------
    world : str
        The file world.json.
    seed : int
        Root of the cell's random numbers.
    **options
        As of `microplan.executor.micromanager.hub.hub`. The camera's device is the
        renderer; it is loaded under the label that `camera` names.

    Raises
    ------
    ExecutorError
        MP803 if the world cannot be read, MP816 for its light; as `hub` for the
        rest.
    ValueError
        If a device is not of the adapters `DEMO`.
    """
    from pymmcore_plus.experimental.unicore import UniMMCore  # an extra

    from microplan.executor.micromanager.rendered_camera import RenderedCamera

    cell, made = build_cell(read_world(Path(world)), seed), list[RenderedHub]()
    table = Table(FILE, "", options)
    label = table.table("camera").text("device")

    def lead() -> None:
        made[0].lead()  # there is one before there is a picture

    def prepare(core: Any) -> None:
        camera = RenderedCamera(cell, lead)
        core.loadPyDevice(label, camera)
        core.initializeDevice(label)

    found = make_hub(table, make=UniMMCore, prepare=prepare)
    try:
        _check_demo(found, label)
        _to_start(found, cell)
        made.append(RenderedHub(found, cell))
    except BaseException:
        found.close()
        raise
    return made[0]


def _check_demo(found: Hub, camera: str) -> None:
    """Raise ValueError if a device may be a real one: that motion is not watched."""
    for label in found.core.getLoadedDevices():
        library = found.core.getDeviceLibrary(label)
        if label not in ("Core", camera) and library not in DEMO:
            raise ValueError(
                f"{label} is of {library}: a rendered hub moves only devices of "
                + ", ".join(DEMO)
            )


def _to_start(found: Hub, cell: Cell) -> None:
    """Bring the devices to where the cell's own start."""
    for device, reading in ((found.stage, cell.stage), (found.robot, cell.robot)):
        if device is not None:
            start = reading.reading()
            device.start(**{name: getattr(start, name) for name in device.names})
            _rest(device)
    if found.jaws is not None:
        found.jaws.start(cell.jaws.reading())
        _rest(found.jaws)
    if found.lens is not None:
        magnification, focus_um = cell.lens.reading()
        found.lens.start_magnification(magnification)
        found.lens.start_focus_um(focus_um)
        _rest(found.lens)


def _rest(device: Mover) -> None:
    """Wait until a device is at rest."""
    began_s = time.monotonic()
    while device.moving():
        if time.monotonic() - began_s > ARRIVE_S:
            device.stop()
            raise TimeoutError(f"{device.serial} moves for more than {ARRIVE_S:g} s")
        time.sleep(POLL_S)
