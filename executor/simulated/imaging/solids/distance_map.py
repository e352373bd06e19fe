"""Signed distance maps of outlines: a raster that rays look up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.solids.plane_outline import (
    PlaneOutline,
    parity_grid,
)

PITCH_UM = 0.2  # of a small body's map
MOST_CELLS = 1600  # along the longer side, before the pitch grows
MARGIN_UM = 12.0  # round the outline; a ray farther away makes more steps
NEAREST_UM = 0.5  # a coarser map is interpolated
CHUNK = 1 << 18  # cells at once

Reals = npt.NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class DistanceMap:
    """Signed distance on a raster in the body's frame: negative inside, um.

    Beyond its border it has the value of the border's nearest cell.
    """

    values: npt.NDArray[np.float32]  # (rows, columns), rows along +y
    x_um: float  # of column 0
    y_um: float  # of row 0
    pitch_um: float  # between cells

    @property
    def coarseness_um(self) -> float:
        """Return the error of a quick look-up, at most."""
        pitch = self.pitch_um
        return pitch * math.sqrt(0.5) if pitch <= NEAREST_UM else 0.1 * pitch

    def quick(self, x: Reals, y: Reals) -> npt.NDArray[np.float32]:
        """Return distances at (...) um points of the body, within `coarseness_um`."""
        if self.pitch_um > NEAREST_UM:
            return self.exact(x, y).astype(np.float32)
        rows, columns = self.values.shape
        i = (x - (self.x_um - self.pitch_um / 2)) * (1 / self.pitch_um)
        j = (y - (self.y_um - self.pitch_um / 2)) * (1 / self.pitch_um)
        np.clip(i, 0, columns - 1, out=i)
        np.clip(j, 0, rows - 1, out=j)
        index = j.astype(np.int32) * np.int32(columns) + i.astype(np.int32)
        return self.values.ravel().take(index)

    def exact(self, x: Reals, y: Reals) -> Reals:
        """Return distances, interpolated between the four cells around."""
        rows, columns = self.values.shape
        i = np.clip((x - self.x_um) * (1 / self.pitch_um), 0, columns - 1.001)
        j = np.clip((y - self.y_um) * (1 / self.pitch_um), 0, rows - 1.001)
        left, low = i.astype(np.int32), j.astype(np.int32)
        u, v = i - left, j - low
        flat, index = self.values.ravel(), low * np.int32(columns) + left
        first = flat.take(index) * (1 - u) + flat.take(index + 1) * u
        index += np.int32(columns)
        after = flat.take(index) * (1 - u) + flat.take(index + 1) * u
        mixed: Reals = first * (1 - v) + after * v
        return mixed

    def normal(self, x: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Return unit vectors that point out of the body, in its frame."""
        step = 1.5 * self.pitch_um
        gx = self.exact(x + step, y) - self.exact(x - step, y)
        gy = self.exact(x, y + step) - self.exact(x, y - step)
        length = np.maximum(np.hypot(gx, gy), 1e-9)
        return gx / length, gy / length


@lru_cache(maxsize=64)
def distance_map(outline: PlaneOutline, near: Box | None = None) -> DistanceMap:
    """Return an outline's map; `near` crops it, in the body's frame."""
    x0, y0, x1, y1 = outline.box
    if near is not None:
        x0, y0 = max(x0, near[0]), max(y0, near[1])
        x1, y1 = max(min(x1, near[2]), x0), max(min(y1, near[3]), y0)
    longer = max(x1 - x0, y1 - y0) + 2 * MARGIN_UM
    pitch = max(PITCH_UM, longer / MOST_CELLS)
    x = np.arange(x0 - MARGIN_UM, x1 + MARGIN_UM + pitch, pitch)
    y = np.arange(y0 - MARGIN_UM, y1 + MARGIN_UM + pitch, pitch)
    inside = parity_grid(outline, x, y)
    values = np.empty(inside.shape, dtype=np.float32)
    many = max(1, CHUNK // len(x))
    for row in range(0, len(y), many):
        rows = slice(row, row + many)
        values[rows] = outline.distance_um(x[None, :], y[rows, None])
    values[inside] *= -1
    return DistanceMap(values, float(x[0]), float(y[0]), float(pitch))


def signed_distance_um(
    outline: PlaneOutline, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return exact signed distances of single points, (N,) um; negative inside.

    Slow and simple: what maps are compared with.
    """
    odd = np.zeros(x.shape, dtype=bool)
    for corners in outline.polygons:
        x0, y0 = corners.T
        x1, y1 = np.roll(x0, -1), np.roll(y0, -1)
        spans = (y0 > y[:, None]) != (y1 > y[:, None])
        rise = np.where(y1 == y0, 1.0, y1 - y0)  # a flat edge never spans
        at = x0 + (y[:, None] - y0) * (x1 - x0) / rise
        odd ^= np.count_nonzero(spans & (x[:, None] < at), axis=1) % 2 == 1
    return np.where(odd, -1.0, 1.0) * outline.distance_um(x, y)
