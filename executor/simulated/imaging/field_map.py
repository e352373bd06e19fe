"""Where pixels look: from the frame to points of the object, lens errors undone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, PixelWindow

ROUNDS = 12  # of the distortion's inverse: a contraction by 3 distortion


@dataclass(frozen=True, eq=False)
class FieldMap:
    """Points of the focal plane that a window's pixels show, (rows, columns) um."""

    x_um: FloatArray
    y_um: FloatArray

    @property
    def box(self) -> Box:
        """Return the least and greatest x and y."""
        x, y = self.x_um, self.y_um
        return (float(x.min()), float(y.min()), float(x.max()), float(y.max()))


def field_map(view: ImagingView, window: PixelWindow) -> FieldMap:
    """Return where the pixels of a window look, in world coordinates."""
    column = window.column + np.arange(window.columns) - (view.width_px - 1) / 2
    row = window.row + np.arange(window.rows) - (view.height_px - 1) / 2
    x, y = np.meshgrid(column / view.px_per_um, -row / view.px_per_um)
    x, y = x - view.shift_um[0], y - view.shift_um[1]
    ratio = view.errors.distortion / view.half_diagonal_um**2
    true_x, true_y = x, y
    for _ in range(ROUNDS if ratio else 0):
        grown = 1 + ratio * (true_x**2 + true_y**2)
        true_x, true_y = x / grown, y / grown
    return FieldMap(true_x, true_y)


def seen_at(
    view: ImagingView, x: FloatArray, y: FloatArray, defocus_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return which points of a plane appear at points of the focal plane, (...) um."""
    errors = view.errors
    scale = 1 + errors.scale_per_um * defocus_um
    return (
        (x - errors.lateral_x * defocus_um) / scale,
        (y - errors.lateral_y * defocus_um) / scale,
    )


def chief_slopes(
    view: ImagingView, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return slopes of the pupil's middle rays on their way down, (...) um per um."""
    errors = view.errors
    return (
        errors.lateral_x + errors.scale_per_um * x,
        errors.lateral_y + errors.scale_per_um * y,
    )


def light_over(view: ImagingView, window: PixelWindow) -> FloatArray:
    """Return the lamp's brightness over a window of px, (rows, columns)."""
    column = window.column + np.arange(window.columns) - (view.width_px - 1) / 2
    row = window.row + np.arange(window.rows) - (view.height_px - 1) / 2
    across = view.lamp.gradient_x * column / view.width_px
    up = -view.lamp.gradient_y * row / view.height_px
    light: FloatArray = view.lamp.level * np.maximum(1 + across + up[:, None], 0.0)
    return light


def focus_at(view: ImagingView, x_um: float, y_um: float) -> float:
    """Return the world height in focus at a point of the field."""
    curved = view.errors.field_curvature_per_um * (x_um**2 + y_um**2) / 2
    return view.focus_um + curved
