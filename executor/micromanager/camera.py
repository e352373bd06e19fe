"""A camera of Micro-Manager: one snapped frame at a time, in a buffer of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from microplan.executor.devices.drivers import Clock, Counts, Frame
from microplan.executor.micromanager.core import describe
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
