"""Micro-Manager's core: opened, its devices loaded, closed before Python ends."""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedDevice:
    """Entry of a device to load: its label, the adapter library, the device in it."""

    label: str
    adapter: str
    device: str
    before: Mapping[str, str] = field(default_factory=dict)  # set before initialisation
    properties: Mapping[str, str] = field(default_factory=dict)  # set after it


def open_core(
    folders: Sequence[str],
    *,
    config: str = "",
    devices: Sequence[LoadedDevice] = (),
    make: Callable[[], CMMCorePlus] | None = None,
) -> CMMCorePlus:
    """Return a core with its devices loaded, that is closed when Python ends.

    Parameters
    ----------
    folders : sequence of str
        Where the device adapters are; empty leaves it to pymmcore-plus.
    config : str
        A Micro-Manager configuration (.cfg); "" loads none.
    devices : sequence of LoadedDevice
        Loaded after the configuration.
    make : callable or None
        Makes the core; None: `CMMCorePlus`.

    Raises
    ------
    OSError, RuntimeError
        If the configuration or a device cannot be loaded; nothing stays loaded then.
    """
    if make is None:
        from pymmcore_plus import CMMCorePlus  # slow to import, and an extra

        make = CMMCorePlus
    core = make()
    close_at_exit(core)
    try:
        if folders:
            core.setDeviceAdapterSearchPaths(list(folders))
        if config:
            core.loadSystemConfiguration(config)
        for device in devices:
            _load(core, device)
    except BaseException:
        close_core(core)
        raise
    return core


def close_core(core: CMMCorePlus) -> None:
    """Stop what moves, unload all devices, wait for their last notifications.

    A device that reports its motion while Python ends aborts the process ("exception
    not rethrown"): its thread asks for an interpreter that is no more. May be called
    twice.
    """
    from pymmcore import CMMCore  # the plus class forbids what is needed here

    for label in _stages(core):
        with suppress(RuntimeError):  # not every stage can be stopped
            core.stop(label)
    with suppress(RuntimeError):
        if core.isSequenceRunning():
            core.stopSequenceAcquisition()
    with suppress(RuntimeError):
        core.unloadAllDevices()
    CMMCore.registerCallback(core, None)  # returns after the last notification


def close_at_exit(core: CMMCorePlus) -> None:
    """Close a core when Python ends, if it is still there."""
    found = weakref.ref(core)

    def close() -> None:
        still = found()
        if still is not None:
            close_core(still)

    atexit.register(close)


def describe(core: CMMCorePlus, label: str) -> str:
    """Return the adapter and device behind a label."""
    return f"{core.getDeviceLibrary(label)} {core.getDeviceName(label)}"


def _stages(core: CMMCorePlus) -> list[str]:
    """Return the labels of everything that can be stopped."""
    from pymmcore_plus import DeviceType

    kinds = (DeviceType.XYStage, DeviceType.Stage)
    return [label for kind in kinds for label in core.getLoadedDevicesOfType(kind)]


def _load(core: CMMCorePlus, device: LoadedDevice) -> None:
    """Load and initialise one device, with its properties."""
    core.loadDevice(device.label, device.adapter, device.device)
    for name, value in device.before.items():
        core.setProperty(device.label, name, value)
    core.initializeDevice(device.label)
    for name, value in device.properties.items():
        core.setProperty(device.label, name, value)
