"""Camera exposures with Micro-Manager: snapped frames under a set light."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from microplan.executor.devices.drivers import Clock, Counts, Frame
from microplan.executor.micromanager.core import describe
from microplan.executor.micromanager.drives import check_limits
from microplan.executor.micromanager.properties import check_property, property_limits
from microplan.schemas.plan import Region

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus


class MMCamera:
    """A camera.

    A frame is exposed from the call on, so its time is that of the call: at or before
    the true one, and never before it was asked for.
    """

    def __init__(
        self, core: CMMCorePlus, label: str, clock: Clock, *, exposure_ms: float | None
    ) -> None:
        self._core, self._label, self._clock = core, label, clock
        core.setCameraDevice(label)
        if exposure_ms is not None:
            core.setExposure(label, exposure_ms)
        self.model, self.serial = describe(core, label), label

    def grab(self, region: Region | None = None, *, after_s: float) -> Frame:
        """Wait until `after_s`, expose, and return the frame; the region is cut out.

        Raises
        ------
        ValueError
            If the region is outside the frame, or the frame is not one plane of 8 or 16
            bits.
        """
        ahead_s = after_s - self._clock.now_s()
        if ahead_s > 0:
            self._clock.wait(ahead_s)
        if self._core.getCameraDevice() != self._label:
            self._core.setCameraDevice(self._label)
        exposed_s = self._clock.now_s()
        self._core.snapImage()
        whole = np.array(self._core.getImage())  # a copy: the core reuses its own
        return Frame(counts=_cut(whole, region), exposed_s=exposed_s)


def _cut(whole: np.ndarray, region: Region | None) -> Counts:
    """Return a region of a frame, checked."""
    if whole.ndim != 2 or whole.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"a frame of shape {whole.shape} and {whole.dtype}, not one plane of uint8 "
            "or uint16"
        )
    if region is None:
        return whole
    rows, columns = whole.shape
    bottom, right = region.row + region.rows, region.column + region.columns
    if min(region.row, region.column) < 0 or bottom > rows or right > columns:
        raise ValueError(f"the camera has {columns} x {rows} px and no {region}")
    return np.ascontiguousarray(whole[region.row : bottom, region.column : right])


class MMLight:
    """A light source.

    Parameters
    ----------
    core : CMMCorePlus
        Has the devices.
    label, property_name : str
        A device and its property that is the brightness; "" and "": only a shutter.
    full : float
        The property's number at level 1.
    shutter : str
        Opened for every level above 0; "" for none. Alone it knows levels 0 and 1.
    """

    def __init__(
        self,
        core: CMMCorePlus,
        label: str = "",
        property_name: str = "",
        *,
        full: float = 1.0,
        shutter: str = "",
    ) -> None:
        self._core, self._label, self._property = core, label, property_name
        self._full, self._shutter = full, shutter
        if label:
            check_property(core, label, property_name)
        self.model = describe(core, label or shutter)
        self.serial = label or shutter
        self.level: float | None = None  # what was set last

    def set_level(self, level: float) -> None:
        """Set the brightness; ValueError if it cannot be had."""
        check_limits(self.serial, {"level": level}, {"level": (0.0, math.inf)})
        if self._label:
            number = {self._property: level * self._full}
            own = property_limits(self._core, self._label, self._property)
            check_limits(self.serial, number, {self._property: own})
            self._core.setProperty(self._label, self._property, level * self._full)
        elif level not in (0.0, 1.0):
            raise ValueError(f"{self.serial} is a shutter: level 0 or 1, not {level:g}")
        if self._shutter:
            self._core.setShutterOpen(self._shutter, level > 0)
        self.level = level
