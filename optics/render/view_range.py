"""Ranges of views of a prepared scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope

ROUNDING_PX = 1e-6  # of pixel positions after conversions; moves no edge visibly


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """What images a scene is prepared for."""

    focus_um: tuple[float, float]  # lowest and highest world height in focus
    shift_um: float = 0.0  # largest displacement along an axis, of either sign
    zoom: tuple[float, float] = (1.0, 1.0)  # least and largest, over the microscope's

    def __post_init__(self) -> None:
        values = (*self.focus_um, self.shift_um, *self.zoom)
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"focus_um, shift_um and zoom must be finite, got {self}")
        if self.focus_um[0] > self.focus_um[1] or self.shift_um < 0:
            raise ValueError(f"a range runs from low to high, got {self}")
        if not 0 < self.zoom[0] <= self.zoom[1]:
            raise ValueError(f"zoom must be positive, from low to high, got {self}")

    def holds(
        self, focus_um: float, shift_um: tuple[float, float], zoom: float
    ) -> bool:
        """Return whether an image lies in the range."""
        return (
            self.focus_um[0] <= focus_um <= self.focus_um[1]
            and max(abs(shift_um[0]), abs(shift_um[1])) <= self.shift_um
            and self.zoom[0] <= zoom <= self.zoom[1]
        )

    def defocus_um(self, z_um: float) -> tuple[float, float]:
        """Return the least and the largest distance of a height from the focus."""
        low, high = z_um - self.focus_um[0], z_um - self.focus_um[1]
        nearest = 0.0 if low * high <= 0 else min(abs(low), abs(high))
        return nearest, max(abs(low), abs(high))

    def frame(self, microscope: Microscope, window: Window) -> Window:
        """Return what may be seen through `window`, in pixels of the microscope."""
        cx, cy = axis_px(microscope)
        reach = self.shift_um * microscope.px_per_um - ROUNDING_PX

        def grown(first: int, count: int, center: float) -> tuple[int, int]:
            ends = [
                (edge - center) / zoom
                for zoom in self.zoom
                for edge in (first, first + count - 1)
            ]
            low = math.floor(center + min(ends) - reach)
            return low, math.ceil(center + max(ends) + reach) - low + 1

        column, columns = grown(window.column, window.columns, cx)
        row, rows = grown(window.row, window.rows, cy)
        return Window(row=row, column=column, rows=rows, columns=columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageView:
    """One image of a range: where its pixels lie, and at what magnification."""

    microscope: Microscope  # as prepared
    focus_um: float
    shift_um: tuple[float, float] = (0.0, 0.0)
    zoom: float = 1.0

    @property
    def setting(self) -> Microscope:
        """Return the microscope at the view's own magnification."""
        m = self.microscope
        if self.zoom == 1:
            return m
        return replace(m, magnification=m.magnification * self.zoom)

    def places(self, frame: Window) -> tuple[FloatArray, FloatArray]:
        """Return positions of a window's rows (R,) and columns (C,), px as prepared."""
        cx, cy = axis_px(self.microscope)
        k = self.microscope.px_per_um
        rows = (np.arange(frame.rows) + (frame.row - cy)) / self.zoom
        columns = (np.arange(frame.columns) + (frame.column - cx)) / self.zoom
        x_um, y_um = self.shift_um
        return np.asarray(cy + rows + k * y_um), np.asarray(cx + columns - k * x_um)


def full(microscope: Microscope) -> Window:
    """Return the whole frame."""
    return Window(
        row=0, column=0, rows=microscope.height_px, columns=microscope.width_px
    )
