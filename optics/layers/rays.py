"""Rays through a pupil, traced to the layers of a scene.

A ray through a point of the plane in focus meets a layer `z` above it at z times its
slope to the side. The layers are hard here, rasters of area coverage on fine cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray
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

    def add(self, other: LayerSheet) -> None:
        """Add another's rasters, in place."""
        self.covers[...] += other.covers
        self.sends[...] += other.sends
        if self.mirrors is not None and other.mirrors is not None:
            self.mirrors[...] += other.mirrors
        for image, more in zip(self.images, other.images, strict=True):
            image.add(more)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """Means over rays at the cells of a grid in the plane in focus."""

    image: FloatArray  # of the layers, each hiding those below
    stack: tuple[LayerSheet, ...]  # of each sheet alone


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


def trace(
    stack: Sequence[LayerSheet],
    background: float,
    shape: tuple[int, int],
    step_um: float,
    tangents: FloatArray,
    focus_um: float,
) -> Traced:
    """Return what rays through the cells of a grid see.

    Parameters
    ----------
    stack : sequence of LayerSheet
        From `hard`, the lowest first.
    shape : (rows, columns)
        The grid.
    step_um : float
        Side of a cell; rays are moved to the nearest cell of each sheet.
    tangents : (N, 2) float64 array
        Slopes of the rays.
    focus_um : float
        World height of the grid.
    """
    image = np.zeros(shape)
    sums = [sheet.mapped(lambda *_: np.zeros(shape)) for sheet in stack]
    for tangent in tangents:
        seen = np.full(shape, background, dtype=np.float32)
        met = partial(_moved, tangent=tangent / step_um, shape=shape, focus_um=focus_um)
        for total, sheet in zip(sums, stack, strict=True):
            view = sheet.mapped(met)
            seen *= 1 - view.covers
            seen += view.sends_all
            total.add(view)
        image += seen
    share = 1 / len(tangents)
    means = tuple(sheet.mapped(lambda raster, _: raster * share) for sheet in sums)
    return Traced(image=image * share, stack=means)


def _moved(
    raster: Raster,
    z_um: float,
    *,
    tangent: FloatArray,
    shape: tuple[int, int],
    focus_um: float,
) -> Raster:
    """Return a sheet's raster where the rays of one slope meet it."""
    rows, columns = shape
    by = (raster.shape[0] - rows) // 2
    z = z_um - focus_um
    across, up = round(z * float(tangent[0])), round(z * float(tangent[1]))
    return raster[by - up : by - up + rows, by + across : by + across + columns]
