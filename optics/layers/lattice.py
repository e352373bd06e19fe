"""Square lattices of slowly varying values: interpolation between points, blur."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline
from scipy.ndimage import distance_transform_edt

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.outline.cell_areas import cells
from microplan.optics.outline.distance_field import BEYOND_UM, even_distances
from microplan.optics.render.pruned_ifft import fast_length
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import tabulate

Area = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max, um
EvenPoints = tuple[float, float, int]  # the first, the step, how many

MORE = 3  # points beyond all that is read: a spline is worse near its ends
_FEW_MORE = 1  # the same of few rays, which err by more than a spline does there
_ROUNDING = 1e-6  # of a step
_EVEN = 16  # points: lattices that end anywhere within as many share cells
# A point's weight in a cubic spline falls by 2 - sqrt(3) a step: below 1e-27 here.
_FELT = 48
_AT_ONCE = 1024  # points whose weights are one array
_DISTANT_UM = 2 * BEYOND_UM - 8  # step at which distances say what cells cover


def margin(finer: float) -> int:
    """Return how many points there are beyond all that is read.

    `finer`: as `microplan.optics.render.sampling.Sampling.rays`.
    """
    return MORE if finer >= 1 else _FEW_MORE


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """Points of a square lattice through the world's origin, rows down."""

    step_um: float
    window: Window  # (0, 0) is the origin

    @property
    def corner_um(self) -> tuple[float, float]:
        """Return (x, y) of the first point."""
        return self.window.column * self.step_um, -self.window.row * self.step_um

    @property
    def shape(self) -> tuple[int, int]:
        """Return (rows, columns)."""
        return self.window.rows, self.window.columns

    @classmethod
    def over(cls, area: Area, step_um: float, *, more: int = MORE) -> Self:
        """Return the points of an area and `more` on all sides of it."""
        x_min, y_min, x_max, y_max = (edge / step_um for edge in area)
        left, top = math.floor(x_min), math.floor(-y_max)
        inner = Window(
            row=top,
            column=left,
            rows=math.ceil(-y_min) - top + 1,
            columns=math.ceil(x_max) - left + 1,
        )
        return cls(step_um=step_um, window=inner).grown(more)

    def grown(self, by: int) -> Self:
        """Return the lattice with `by` more points on every side."""
        w = self.window
        wide = Window(
            row=w.row - by,
            column=w.column - by,
            rows=w.rows + 2 * by,
            columns=w.columns + 2 * by,
        )
        return replace(self, window=wide)

    def cells(self, layer: Layer) -> FloatArray:
        """Return the coverage of the square about each point, (rows, columns), 0..1."""
        x, y = self.corner_um
        half = self.step_um / 2
        return cells(layer.outline, x - half, y + half, self.step_um, self.shape)

    def covered(self, layer: Layer, finer: float) -> Float32Array:
        """Return `held_cells`; of trials' rays what distances from its edges say.

        (rows, columns), not to be changed. `finer`: as
        `microplan.optics.render.sampling.Sampling.rays`. Distances are kept while a
        body moves. At an edge askew the share is .04 off at most, at a corner .25.
        """
        if finer >= 1 or self.step_um > _DISTANT_UM or not layer.outline.rings:
            return self.held_cells(layer)
        found = even_distances(layer.outline, self.corner_um, self.step_um, self.shape)
        np.multiply(found, np.float32(-1 / self.step_um), out=found)
        found += np.float32(0.5)
        return np.clip(found, 0, 1, out=found)

    def held_cells(self, layer: Layer) -> Float32Array:
        """Return `cells` in single precision, (rows, columns), 0..1, not to be changed.

        What was asked for not long ago of this lattice or of one a little larger or
        smaller is given again.
        """
        w = self.window
        top, left = (_EVEN * (first // _EVEN) for first in (w.row, w.column))
        down, right = w.row - top, w.column - left
        rows, columns = (
            _EVEN * math.ceil(count / _EVEN)
            for count in (down + w.rows, right + w.columns)
        )
        even = Window(row=top, column=left, rows=rows, columns=columns)
        found = _held_cells(layer, replace(self, window=even))
        return found[down : down + w.rows, right : right + w.columns]

    def read(
        self,
        values: FloatArray,
        x: EvenPoints,
        y: EvenPoints,
        *,
        beyond_um: float = 0.0,
    ) -> FloatArray:
        """Return values between the points, by cubic splines.

        Parameters
        ----------
        values : (rows, columns) float64 array
            At the points.
        x, y : (first, step, count)
            Where the columns and the rows wanted lie, um; y falls if its step does.
        beyond_um : float
            Reach of extrapolation beyond the points, with the last ones' values.

        Raises
        ------
        ValueError
            If a position lies farther outside.
        """
        (left, top), step = self.corner_um, self.step_um
        rows, columns = self.shape
        far = beyond_um / step + _ROUNDING
        lines = np.empty((y[2], columns))
        down = (top - y[0]) / step, -y[1] / step, y[2]
        for out, part, weights in _blocks(rows, down, far):
            lines[out] = weights @ values[part]
        found = np.empty((y[2], x[2]))
        across = (x[0] - left) / step, x[1] / step, x[2]
        for out, part, weights in _blocks(columns, across, far):
            found[:, out] = lines[:, part] @ weights.T
        return found


def _blocks(
    points: int, places: EvenPoints, beyond: float
) -> Iterator[tuple[slice, slice, FloatArray]]:
    """Yield slices of positions and points, and the weights between them."""
    first, step, count = places
    if points <= _AT_ONCE:
        yield slice(None), slice(None), _spline(points, first, step, count, beyond)
        return
    size = max(1, math.floor(_AT_ONCE / 2 / abs(step)))
    for start in range(0, count, size):
        stop = min(start + size, count)
        ends = first + step * start, first + step * (stop - 1)
        low = max(0, min(math.floor(min(ends)) - _FELT, points - 2 * _FELT))
        high = min(points, max(math.ceil(max(ends)) + _FELT, 2 * _FELT))
        weights = _spline(high - low, ends[0] - low, step, stop - start, beyond)
        yield slice(start, stop), slice(low, high), weights


@lru_cache(maxsize=32)
def _held_cells(layer: Layer, lattice: Lattice) -> Float32Array:
    found = lattice.cells(layer).astype(np.float32)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=128)
def _spline(
    points: int, first: float, step: float, count: int, beyond: float
) -> FloatArray:
    """Return weights (count, points) of values at 0, 1, ... for even positions."""
    at = first + step * np.arange(count)
    if at.min() < -beyond or at.max() > points - 1 + beyond:
        raise ValueError("the light was not computed for so wide a window or defocus")
    at = np.clip(at, 0, points - 1)
    i = np.minimum(at.astype(np.intp), points - 2)
    t = (at - i)[:, None]
    slopes = _slopes(points)
    # Hermite's cubics: of the ends' values, and of their slopes
    weights: FloatArray = t * (1 - t) ** 2 * slopes[i] - t**2 * (1 - t) * slopes[i + 1]
    rise, line = t[:, 0] ** 2 * (3 - 2 * t[:, 0]), np.arange(count)
    weights[line, i] += 1 - rise
    weights[line, i + 1] += rise
    weights.setflags(write=False)
    return weights


@lru_cache(maxsize=64)
def _slopes(points: int) -> FloatArray:
    """Return the slopes of a cubic spline from its values at 0, 1, ..., square."""
    spline = CubicSpline(np.arange(points), np.eye(points))
    slopes = np.concatenate([spline.c[2], spline(points - 1, 1)[None]])
    slopes.setflags(write=False)
    return slopes


def continued(values: FloatArray) -> FloatArray:
    """Return shares of a lattice, (rows, columns), where some are nan: as the nearest.

    0 if all are.
    """
    missing = np.isnan(values)
    if not missing.any():
        return values
    if missing.all():
        return np.zeros(values.shape)
    nearest = distance_transform_edt(
        missing, return_distances=False, return_indices=True
    )
    found: FloatArray = values[tuple(nearest)]
    return found


def blur(
    values: FloatArray,
    step_um: float,
    microscope: Microscope,
    model: str,
    z_um: float,
    *,
    cell_um: float = 0.0,
) -> FloatArray:
    """Return values of a lattice as pixels see them there, blurred by a defocus.

    Parameters
    ----------
    values : (N, rows, columns) or (rows, columns) float64 array
        At points `step_um` apart, continued by their mirror images, or first by the
        last ones' values to a length that transforms fast.
    step_um : float
        Distance of the points.
    microscope, model, z_um
        As in `microplan.optics.transfer.models.transfer`.
    cell_um : float
        Side of the square that each value is the mean of, at most `step_um`.
    """
    rows, columns = values.shape[-2:]
    wide = fast_length(rows), fast_length(columns)
    v, u = (np.arange(size) / (2 * size * step_um) for size in wide)
    x = np.hypot(u, v[:, None]) / microscope.cutoff_per_um
    top = min(float(x.max()), 1.0)
    gain = tabulate(model, microscope, z_um, top).read(np.minimum(x, top))
    side = microscope.side_um
    gain = np.where(x < 1, gain, 0.0) * np.sinc(u * side) * np.sinc(v * side)[:, None]
    gain /= np.sinc(u * cell_um) * np.sinc(v * cell_um)[:, None]
    # what is blurred is a share of light: single precision adds 1e-6 (tested)
    held = np.empty((*values.shape[:-2], *wide), dtype=np.float32)
    held[..., :rows, :columns] = values
    held[..., :rows, columns:] = values[..., -1:]
    held[..., rows:, :] = held[..., rows - 1 : rows, :]
    waves = fft.dctn(held, axes=(-2, -1), overwrite_x=True)
    waves *= gain.astype(np.float32)
    found = fft.idctn(waves, axes=(-2, -1), overwrite_x=True)
    return found[..., :rows, :columns].astype(np.float64)
