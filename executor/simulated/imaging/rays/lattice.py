"""Lattices of points on which smooth pictures are computed and interpolated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, Box, FloatArray, IntArray

Reals = npt.NDArray[np.floating]
Reals32 = npt.NDArray[np.float32]
_Reals = TypeVar("_Reals", npt.NDArray[np.float64], npt.NDArray[np.float32])

FILLED = 4  # rounds of unknown points next to known ones


@dataclass(frozen=True, eq=False)
class PointLattice:
    """Points at x_um[0] + i spacing, y_um[0] + j spacing."""

    x_um: FloatArray  # (columns,)
    y_um: FloatArray  # (rows,)
    spacing_um: float

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Return x and y of all points, um, row by row, (N,) each."""
        x, y = np.meshgrid(self.x_um, self.y_um)
        return x.ravel(), y.ravel()

    def smooth(self, values: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return (rows, columns) values interpolated onto a grid of um, (Y, X)."""
        across = cubic_weights((x - self.x_um[0]) / self.spacing_um, len(self.x_um))
        down = cubic_weights((y - self.y_um[0]) / self.spacing_um, len(self.y_um))
        grid: FloatArray = down @ values @ across.T
        return grid

    def straight(self, values: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return (rows, columns) values on a grid of um, (Y, X), straight between."""
        row, down = _linear((y - self.y_um[0]) / self.spacing_um, len(self.y_um))
        column, across = _linear((x - self.x_um[0]) / self.spacing_um, len(self.x_um))
        part = values[row] * (1 - down[:, None]) + values[row + 1] * down[:, None]
        grid: FloatArray = part[:, column] * (1 - across) + part[:, column + 1] * across
        return grid

    def smooth_at(self, values: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return (rows, columns) values interpolated at points nearly on a grid.

        `x`, `y` : (M, N) um float arrays whose rows and columns are all but straight;
        what they deviate from the grid's mean is followed along the slope.
        """
        mean_x, mean_y = x.mean(axis=0), y.mean(axis=1)
        grid = self.smooth(values, mean_x, mean_y)
        away_x, away_y = x - mean_x, y - mean_y[:, None]
        if not (np.any(away_x) or np.any(away_y)):
            return grid
        down, across = np.gradient(grid, mean_y, mean_x)
        followed: FloatArray = grid + away_x * across + away_y * down
        return followed

    def finer(self, factor: int) -> PointLattice:
        """Return a lattice over the same range with more points."""
        spacing = self.spacing_um / factor
        across, down = (
            np.arange(factor * (len(along) - 1) + 1, dtype=float)
            for along in (self.x_um, self.y_um)
        )
        return PointLattice(
            x_um=self.x_um[0] + spacing * across,
            y_um=self.y_um[0] + spacing * down,
            spacing_um=spacing,
        )

    def holding(self, x: Reals32, y: Reals32) -> BoolArray:
        """Return which cells hold any of (N,) um points, (rows, columns) bool.

        A cell has the number of its first corner.
        """
        step, columns = np.float32(1 / self.spacing_um), np.int32(len(self.x_um))
        u = (x - np.float32(self.x_um[0])) * step
        v = (y - np.float32(self.y_um[0])) * step
        np.clip(u, 0, len(self.x_um) - 1.001, out=u)
        np.clip(v, 0, len(self.y_um) - 1.001, out=v)
        cells = np.zeros(len(self.y_um) * len(self.x_um), dtype=bool)
        cells[v.astype(np.int32) * columns + u.astype(np.int32)] = True
        return cells.reshape(len(self.y_um), len(self.x_um))


def lattice_over(box: Box, spacing_um: float) -> PointLattice:
    """Return a lattice that reaches two points beyond a box."""
    x0, y0, x1, y1 = box
    across, down = (
        np.arange(math.ceil(wide / spacing_um) + 5, dtype=float) - 2
        for wide in (x1 - x0, y1 - y0)
    )
    return PointLattice(
        x_um=x0 + spacing_um * across,
        y_um=y0 + spacing_um * down,
        spacing_um=spacing_um,
    )


def widened(mask: BoolArray) -> BoolArray:
    """Return a (rows, columns) bool mask with the eight neighbours of each point."""
    rows, columns = mask.shape
    padded, wide = np.pad(mask, 1), mask.copy()
    for i in range(3):
        for j in range(3):
            wide |= padded[i : i + rows, j : j + columns]
    return wide


def filled(values: _Reals, known: BoolArray) -> _Reals:
    """Return (rows, columns, ...) values, unknown ones from their known neighbours."""
    known = known.copy()
    if not known.any() or known.all():
        return values
    mean = values[known].mean(axis=0)
    wide = known.reshape(known.shape + (1,) * (values.ndim - 2))
    values = np.where(wide, values, np.zeros_like(values))
    rows, columns = known.shape
    for _ in range(FILLED):
        there = np.pad(known, 1)
        sides = [(0, 1), (2, 1), (1, 0), (1, 2), (0, 0), (0, 2), (2, 0), (2, 2)]
        found = [there[i : i + rows, j : j + columns] for i, j in sides]
        count = np.sum(found, axis=0)
        row, column = np.nonzero(~known & (count > 0))
        total = np.zeros((len(row), *values.shape[2:]), dtype=values.dtype)
        for i, j in sides:
            r, c = row + i - 1, column + j - 1
            inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
            total[inside] += values[r[inside], c[inside]]
        share = count[row, column].reshape((-1,) + (1,) * (values.ndim - 2))
        values[row, column] = (total / share).astype(values.dtype)
        known[row, column] = True
    values[~known] = mean
    return values


def _linear(at: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return the point before each place, of `count`, and the share of the next."""
    at = np.clip(at, 0, count - 1 - 1e-6)
    first = np.floor(at).astype(np.intp)
    return first, at - first


def cubic_weights(at: FloatArray, count: int) -> FloatArray:
    """Return weights of `count` points for Catmull-Rom interpolation, (len(at), count).

    Two points are needed beyond each end; farther out the ends hold on.
    """
    at = np.clip(at, 1, count - 2 - 1e-6)
    first = np.floor(at).astype(int)
    t = (at - first)[:, None]
    parts = np.hstack([
        -t + 2 * t**2 - t**3,
        2 - 5 * t**2 + 3 * t**3,
        t + 4 * t**2 - 3 * t**3,
        -(t**2) + t**3,
    ])  # fmt: skip
    weights = np.zeros((len(at), count))
    rows = np.arange(len(at))
    for k in range(4):
        weights[rows, first + k - 1] += parts[:, k] / 2
    return weights
