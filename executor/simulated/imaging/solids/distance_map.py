"""Signed distance maps of outlines: a raster that rays look up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.solids.plane_outline import (
    PlaneOutline,
    edge_box,
    edge_square,
    parity_grid,
)

PITCH_UM = 0.2  # of a small body's map
MOST_CELLS = 1600  # along the longer side, before the pitch grows
MARGIN_UM = 12.0  # round the outline; a ray farther away makes more steps
NEAREST_UM = 0.5  # a coarser map is interpolated
EVEN, BESIDE = 0.98, 4.0  # slope that is less, and cells from a corner at most
EXACT_UM = 5.0  # from an edge: farther away than a beam's side is
FEW = 4  # cells to one that is computed, farther away

Reals = npt.NDArray[np.floating]
Reals32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class DistanceMap:
    """Signed distance on a raster in the body's frame: negative inside, um.

    Beyond its border it has the value of the border's nearest cell.
    """

    values: npt.NDArray[np.float32]  # (rows, columns), rows along +y
    x_um: float  # of column 0
    y_um: float  # of row 0
    pitch_um: float  # between cells
    corners: FloatArray  # (N, 6), as `PlaneOutline.corners`

    @property
    def coarseness_um(self) -> float:
        """Return the error of a quick look-up, at most."""
        pitch = self.pitch_um
        return pitch * math.sqrt(0.5) if pitch <= NEAREST_UM else 0.1 * pitch

    def cells(self, x: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Return where (...) um points are on the raster, in cells."""
        scale = x.dtype.type(1 / self.pitch_um)
        left, low = x.dtype.type(self.x_um), x.dtype.type(self.y_um)
        return (x - left) * scale, (y - low) * scale

    def quick_at(self, i: Reals32, j: Reals32) -> Reals32:
        """Return distances at (...) places in cells, within `coarseness_um`."""
        if self.pitch_um > NEAREST_UM:
            return self._between((self.values.ravel(),), i, j)[0]
        rows, columns = self.values.shape
        i, j = i + np.float32(0.5), j + np.float32(0.5)
        _clip(i, columns - 1)
        _clip(j, rows - 1)
        index = j.astype(np.int32)
        index *= np.int32(columns)
        index += i.astype(np.int32)
        return self.values.ravel().take(index)

    def quick(self, x: Reals, y: Reals) -> Reals32:
        """Return distances at (...) um points of the body, within `coarseness_um`."""
        i, j = self.cells(x, y)
        return self.quick_at(i.astype(np.float32), j.astype(np.float32))

    def exact(self, x: Reals, y: Reals) -> Reals:
        """Return distances, interpolated between the four cells around."""
        return self._between((self.values.ravel(),), *self.cells(x, y))[0]

    def normal(self, x: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Return unit vectors that point out of the body, in its frame."""
        _, gx, gy = self.surface(x, y)
        return gx, gy

    def surface(self, x: Reals, y: Reals) -> tuple[Reals, Reals, Reals]:
        """Return distances as `exact` does, and unit vectors as `normal` does.

        Beside a corner, where slopes are means over both its edges, the nearer one's.
        """
        planes = (self.values.ravel(), *self._slopes)
        away, gx, gy = self._between(planes, *self.cells(x, y))
        length = np.maximum(np.hypot(gx, gy), 1e-9)
        gx, gy = gx / length, gy / length
        mixed = length < 6 * EVEN * self.pitch_um
        if len(self.corners) and mixed.any():
            gx[mixed], gy[mixed] = self._beside_corners(
                x[mixed], y[mixed], gx[mixed], gy[mixed]
            )
        return away, gx, gy

    def _beside_corners(
        self, x: Reals, y: Reals, nx: Reals, ny: Reals
    ) -> tuple[Reals, Reals]:
        """Return (N,) unit vectors across the nearer edges of corners near points.

        On the side of those given, which are returned where no corner is near.
        """
        square = (x[:, None] - self.corners[:, 0]) ** 2
        square += (y[:, None] - self.corners[:, 1]) ** 2
        nearest = square.argmin(axis=1)
        close = square.min(axis=1) < (BESIDE * self.pitch_um) ** 2
        cx, cy, ax, ay, bx, by = self.corners[nearest].T
        dx, dy = x - cx, y - cy
        before = dx * ax + dy * ay > dx * bx + dy * by
        tx, ty = np.where(before, ax, bx), np.where(before, ay, by)
        side = np.where(nx * ty - ny * tx < 0, -1.0, 1.0)
        return np.where(close, side * ty, nx), np.where(close, -side * tx, ny)

    @cached_property
    def _slopes(self) -> tuple[Reals32, Reals32]:
        """Return how distances grow along x and y across three cells, (cells,) each."""
        padded = np.pad(self.values, 2, mode="edge")
        # at half cells: the mean of two differences, from 1 and from 2 cells away
        across = padded[2:-2, 4:] - padded[2:-2, :-4]
        across += padded[2:-2, 3:-1] - padded[2:-2, 1:-3]
        down = padded[4:, 2:-2] - padded[:-4, 2:-2]
        down += padded[3:-1, 2:-2] - padded[1:-3, 2:-2]
        return across.ravel(), down.ravel()

    def _between(self, planes: Sequence[Reals32], i: Reals, j: Reals) -> list[Reals]:
        """Return flat rasters' values between the four cells around places in cells."""
        rows, columns = self.values.shape
        i, j = i + 0, j + 0
        _clip(i, columns - 1.001)
        _clip(j, rows - 1.001)
        left, low = i.astype(np.int32), j.astype(np.int32)
        u, v = i - left.astype(i.dtype), j - low.astype(j.dtype)
        index = low * np.int32(columns) + left
        right, above = index + np.int32(1), index + np.int32(columns)
        corner = above + np.int32(1)
        found = []
        for flat in planes:
            first = flat.take(index)
            first = first + u * (flat.take(right) - first)
            after = flat.take(above)
            after = after + u * (flat.take(corner) - after)
            found.append(first + v * (after - first))
        return found


def _clip(places: Reals, most: float) -> None:
    """Bring (...) places between 0 and the last cell; `np.clip` takes twice as long."""
    np.maximum(places, 0, out=places)
    np.minimum(places, most, out=places)


@lru_cache(maxsize=16)
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
    values = _distances(outline, x, y)
    values[parity_grid(outline, x, y)] *= -1
    return DistanceMap(values, float(x[0]), float(y[0]), float(pitch), outline.corners)


def _distances(
    outline: PlaneOutline, x: FloatArray, y: FloatArray
) -> npt.NDArray[np.float32]:
    """Return distances to the nearest edge on a grid of um, (len(y), len(x)).

    Within `EXACT_UM` each cell's; beyond, straight between those of every `FEW`th.
    """
    wide_um = FEW * float(x[1] - x[0])
    few_x, few_y = (
        along[0] + wide_um * np.arange(-(-(len(along) - 1) // FEW) + 1)
        for along in (x, y)
    )
    few = outline.distance_um(few_x[None, :], few_y[:, None]).astype(np.float32)
    share = (np.arange(FEW, dtype=np.float32) / FEW)[:, None]
    rows = few[:-1, None] + share * (few[1:, None] - few[:-1, None])
    rows = np.vstack([rows.reshape(-1, len(few_x)), few[-1:]])[: len(y)]
    columns = rows[:, :-1, None] + share.T * (rows[:, 1:, None] - rows[:, :-1, None])
    columns = np.hstack([columns.reshape(len(y), -1), rows[:, -1:]])[:, : len(x)]
    square = np.where(columns < EXACT_UM, np.float32(np.inf), columns**2)
    for edge in (edge for ring in outline.rings for edge in ring):
        x0, y0, x1, y1 = edge_box(edge)
        reach = EXACT_UM + wide_um  # above what a cell's distance may be then
        left, right = np.searchsorted(x, (x0 - reach, x1 + reach))
        low, high = np.searchsorted(y, (y0 - reach, y1 + reach))
        part = square[low:high, left:right]
        if part.size:
            found = edge_square(edge, x[None, left:right], y[low:high, None])
            part[:] = np.minimum(part, found)
    return np.sqrt(square)


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
