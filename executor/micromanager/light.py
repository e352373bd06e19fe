"""The light: a property with a full value, a shutter, or both."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from microplan.executor.micromanager.core import describe
from microplan.executor.micromanager.drives import check_limits
from microplan.executor.micromanager.properties import check_property, property_limits

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus


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
