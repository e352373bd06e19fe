"""Rays through a pupil, traced to the layers of a scene.

A ray through a point of the plane in focus meets a layer `z` above it at z times its
slope to the side. The layers are hard here, rasters of area coverage on fine cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.optics.outline.cell_areas import cells
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

_GOLDEN_RAD = math.pi * (1 + math.sqrt(5))
# Coverages of one height add up to 1 at most unless bodies overlap; the rest is error
# of the band and the margin, as in `microplan.optics.render.render`.
_SHARED = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """A rectangle of fine cells, rows going down."""

    left_um: float
    top_um: float
    step_um: float
    shape: tuple[int, int]

    def grown(self, by: int) -> Grid:
        """Return the grid with `by` more cells on every side."""
        rows, columns = self.shape
        return Grid(
            left_um=self.left_um - by * self.step_um,
            top_um=self.top_um + by * self.step_um,
            step_um=self.step_um,
            shape=(rows + 2 * by, columns + 2 * by),
        )


# a raster (rows, columns) of a sheet at a world height, um, to another
Raster = FloatArray | Float32Array
RasterMap = Callable[[Raster, float], Raster]


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSheet:
    """All layers of one height: what they cover, and what they send back."""

    z_um: float
    covers: FloatArray | Float32Array  # (rows, columns), 0..1
    sends: FloatArray | Float32Array  # (rows, columns), reflectance times coverage
    # what it sends besides as a mirror, past images of higher sheets
    mirrors: FloatArray | Float32Array | None = None
    images: tuple[LayerSheet, ...] = ()

    @property
    def sends_all(self) -> FloatArray | Float32Array:
        """Return what it sends back in all, (rows, columns)."""
        if self.mirrors is None:
            return self.sends
        return self.sends + math.prod(
            (1 - image.covers for image in self.images), start=self.mirrors
        )

    def mapped(self, by: RasterMap) -> LayerSheet:
        """Return the sheet with each raster replaced, its images' too."""
        return LayerSheet(
            z_um=self.z_um,
            covers=by(self.covers, self.z_um),
            sends=by(self.sends, self.z_um),
            mirrors=None if self.mirrors is None else by(self.mirrors, self.z_um),
            images=tuple(image.mapped(by) for image in self.images),
        )


def slopes(microscope: Microscope, count: int) -> FloatArray:
    """Return slopes of rays that fill the pupil evenly.

    Parameters
    ----------
    count : int
        How many, at least 1.

    Returns
    -------
    (count, 2) float64 array
        Tangents along x and y, of equal weight: rho A / sqrt(n**2 - A**2 rho**2) at
        the points of a golden spiral over the pupil's area.

    References
    ----------
    Vogel (1979), Math. Biosci. 44, 179, for the spiral.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    i = np.arange(count) + 0.5
    s = microscope.cone_aperture * np.sqrt(i / count)
    tangent = s / np.sqrt(microscope.medium_index**2 - s**2)
    angle = _GOLDEN_RAD * i
    return np.stack([tangent * np.cos(angle), tangent * np.sin(angle)], axis=1)


def sheets(
    layers: Sequence[Layer], covers: Sequence[FloatArray | Float32Array]
) -> list[LayerSheet]:
    """Gather layers and coverages (rows, columns), 0..1, by height, the lowest first.

    Where bodies of one height overlap, the last by name is the upper one.
    """
    pairs = sorted(
        zip(layers, covers, strict=True), key=lambda p: (p[0].z_um, p[0].name)
    )
    found = []
    for z_um, group in itertools.groupby(pairs, key=lambda p: p[0].z_um):
        found.append(_joined(z_um, list(group)))
    return found


def _joined(
    z_um: float, group: list[tuple[Layer, FloatArray | Float32Array]]
) -> LayerSheet:
    """Join the layers of one height; side by side they add up."""
    first, cover = group[0]
    covers, sends = cover, first.reflectance * cover
    total = np.sum([c for _, c in group], axis=0)
    side_by_side = float(total.max()) <= 1 + _SHARED
    for layer, cover in group[1:]:
        hidden = 0.0 if side_by_side else cover
        covers = covers * (1 - hidden) + cover
        sends = sends * (1 - hidden) + layer.reflectance * cover
    return LayerSheet(z_um=z_um, covers=covers, sends=sends)


def composite(
    stack: Sequence[LayerSheet], background: float, shape: tuple[int, ...]
) -> FloatArray:
    """Return sheets composited over a background, (rows, columns), share of full scale.

    From the lowest to the highest.
    """
    image = np.full(shape, background)
    for sheet in stack:
        image *= 1 - sheet.covers
        image += sheet.sends_all
    return image


def extent(where: BoolArray) -> tuple[slice, slice] | None:
    """Return the rows and columns of the true samples of (rows, columns), or None."""
    if not where.any():
        return None
    rows, columns = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def reach_cells(z_um: float, microscope: Microscope, step_um: float) -> int:
    """Return how many cells sideways the marginal ray meets a sheet."""
    return math.ceil(microscope.blur_diameter_um(z_um) / 2 / step_um)


def hard(
    layers: Sequence[Layer], grid: Grid, microscope: Microscope, focus_um: float
) -> list[LayerSheet]:
    """Return rasters of layers by height, each wider than `grid` by its blur."""
    found = []
    for z_um in sorted({layer.z_um for layer in layers}):
        own = [layer for layer in layers if layer.z_um == z_um]
        by = reach_cells(z_um - focus_um, microscope, grid.step_um)
        wide = grid.grown(by)
        rasters = [
            cells(
                layer.outline, wide.left_um, wide.top_um, wide.step_um, wide.shape
            ).astype(np.float32)
            for layer in own
        ]
        found.extend(sheets(own, rasters))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Fan:
    """Rays through the cells of a grid, moved to the nearest cell of each sheet."""

    shape: tuple[int, int]  # rows, columns of the grid
    step_um: float  # side of a cell
    tangents: FloatArray  # (N, 2), slopes of the rays
    focus_um: float  # world height of the grid

    def views(self, raster: Raster, z_um: float) -> list[Raster]:
        """Return what each ray of all cells meets of a sheet, (rows, columns) each."""
        (rows, columns), by = self.shape, self._rim(raster)
        return [
            raster[down : down + rows, right : right + columns]
            for down, right in (by + self._aside(z_um)).tolist()
        ]

    def mean(self, raster: Raster, z_um: float) -> FloatArray:
        """Return the mean over rays of what they meet of a sheet, (rows, columns)."""
        by = self._rim(raster)
        weights = np.zeros((2 * by + 1, 2 * by + 1))
        np.add.at(weights, tuple((by + self._aside(z_um)).T), 1 / len(self.tangents))
        found: FloatArray = correlate(raster.astype(np.float64), weights, "valid")
        return found

    def _rim(self, raster: Raster) -> int:
        """Return how many cells a raster has more than the grid on every side."""
        rim: int = (raster.shape[0] - self.shape[0]) // 2
        return rim

    def _aside(self, z_um: float) -> IntArray:
        """Return how many cells down and right rays meet a sheet, (N, 2)."""
        z = (z_um - self.focus_um) / self.step_um
        found: IntArray = np.rint(z * self.tangents[:, ::-1] * [-1, 1]).astype(np.intp)
        return found


def trace(stack: Sequence[LayerSheet], background: float, fan: Fan) -> FloatArray:
    """Return what rays through the cells of a grid see in the mean, (rows, columns).

    Shares of full scale; sheets, from `hard`, are the lowest first.
    """
    image = np.zeros(fan.shape)
    views = [_views(sheet, fan) for sheet in stack]
    for ray in range(len(fan.tangents)):
        seen = np.full(fan.shape, background, dtype=np.float32)
        for free, sends, mirrors, *images in views:
            seen *= free[ray]
            seen += sends[ray]
            if mirrors:
                seen += math.prod((each[ray] for each in images), start=mirrors[ray])
        image += seen
    return image / len(fan.tangents)


def _views(sheet: LayerSheet, fan: Fan) -> list[list[Raster]]:
    """Return what rays meet of what a sheet leaves free, sends and mirrors.

    Then of what each image in it leaves free; without a mirror the third is empty.
    """
    plain = [(1 - sheet.covers, sheet.z_um), (sheet.sends, sheet.z_um)]
    found = [fan.views(raster, z_um) for raster, z_um in plain]
    if sheet.mirrors is None:
        return [*found, []]
    images = [fan.views(1 - image.covers, image.z_um) for image in sheet.images]
    return [*found, fan.views(sheet.mirrors, sheet.z_um), *images]
