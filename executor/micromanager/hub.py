"""Micro-Manager as a hub of a station file: stage, robot, jaws, lens, light, camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from microplan.executor.devices.tables import Table
from microplan.executor.devices.timeouts import WallClock
from microplan.executor.micromanager.core import close_core, open_core
from microplan.executor.micromanager.exposure import MMCamera, MMLight
from microplan.executor.micromanager.movers import MMAxes, MMGripper, MMLens
from microplan.executor.micromanager.options import (
    axes,
    drive,
    light,
    loaded_devices,
    moved,
)

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

FILE = "micromanager"  # what messages call the hub's options


@dataclass(frozen=True, slots=True, kw_only=True)
class Hub:
    """A core and the devices made of it; None is what the options do not name."""

    core: CMMCorePlus
    clock: WallClock
    stage: MMAxes | None
    robot: MMAxes | None
    jaws: MMGripper | None
    lens: MMLens | None
    light: MMLight | None
    camera: MMCamera | None

    def close(self) -> None:
        """Stop, unload and drain; Python's end does it too."""
        close_core(self.core)


def hub(**options: Any) -> Hub:
    """Return the devices of a Micro-Manager configuration or device table.

    Parameters
    ----------
    **options
        The keys of the hub's table in a station file, see docs/drivers.md.

    Raises
    ------
    ExecutorError
        MP812 for an option that cannot be understood.
    OSError, RuntimeError
        If Micro-Manager cannot load a device.
    """
    return make_hub(Table(FILE, "", options))


def make_hub(
    table: Table,
    *,
    make: Callable[[], CMMCorePlus] | None = None,
    prepare: Callable[[CMMCorePlus], None] = lambda _core: None,
) -> Hub:
    """Return a hub of a table; `prepare` sees the core before devices are made of it.

    Everything that can be checked without a device is checked before one is loaded.
    """
    folders, config = _folders(table), table.text("config", "")
    devices = loaded_devices(table.table("load"))
    parts = {name: table.table(name) for name in _ROLES if table.has(name)}
    table.finish()
    core = open_core(folders, config=config, devices=devices, make=make)
    try:
        prepare(core)
        return _built(core, parts)
    except BaseException:
        close_core(core)
        raise


def _built(core: CMMCorePlus, parts: Mapping[str, Table]) -> Hub:
    """Return the devices that have a table."""
    clock = WallClock()
    found: dict[str, Any] = dict.fromkeys(_ROLES)
    for role, table in parts.items():
        match role:
            case "stage" | "robot":
                found[role] = axes(core, table, role)
            case "jaws":
                opening = drive(core, table, "opening_um")
                found[role] = moved(MMGripper, core, role, [opening])
            case "lens":
                found[role] = _lens(core, table)
            case "light":
                found[role] = light(core, table)
            case "camera":
                found[role] = _camera(core, table, clock)
    return Hub(core=core, clock=clock, **found)


def _lens(core: CMMCorePlus, table: Table) -> MMLens:
    """Return zoom and focus."""
    zoom = drive(core, table.table("zoom"), "magnification")
    focus = drive(core, table.table("focus"), "focus_um")
    table.finish()
    return moved(MMLens, core, "lens", [zoom, focus])


def _camera(core: CMMCorePlus, table: Table, clock: WallClock) -> MMCamera:
    """Return the camera."""
    exposure_ms = (
        table.number("exposure_ms", above=0) if table.has("exposure_ms") else None
    )
    label = table.text("device")
    table.finish()
    return MMCamera(core, label, clock, exposure_ms=exposure_ms)


_ROLES = ("stage", "robot", "jaws", "lens", "light", "camera")
TEST_ADAPTERS = "test"  # the demo devices of the package mm-test-adapters


def _folders(table: Table) -> list[str]:
    """Return where device adapters are; none leaves it to pymmcore-plus."""
    if not table.has("adapters"):
        return []
    folder = table.text("adapters")
    if folder != TEST_ADAPTERS:
        return [folder]
    from mm_test_adapters import device_adapter_path  # an extra of an extra

    return [device_adapter_path()]
