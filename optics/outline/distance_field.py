"""Signed distances from an outline on a grid in the outline's own frame, kept.

Bodies that only move share their grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from microplan.arrays import BoolArray, Box, Float32Array, FloatArray, Point
from microplan.optics.outline.cell_areas import cells
from microplan.optics.outline.clip import EdgeArrays
from microplan.optics.outline.outline import Outline
from microplan.optics.outline.own_frame import OwnEdges, own_edges, own_frame

STEP_UM = 0.5  # of the grid: a distance errs by half the diagonal, .35 um, at most
BEYOND_UM = 24.0  # of the edges: farther off the distance is this or more
_TILE = 48  # points
_WHOLE = 1 << 20  # points of a grid that an outline has all over, wherever it is wanted
_CORNER = 0.95  # cosine of a turn; less is a corner
_POINT_UM = 2e-5  # ends are rounded to half of it
_EVEN_UM = 256.0  # others end at whole multiples: areas nearly alike share grids


@dataclass(frozen=True, slots=True, eq=False)
class DistanceGrid:
    """Distances at the points of one grid; two are equal if they are one object."""

    values: Float32Array  # (rows, columns), y upwards
    # (6, N): places in the grid's steps, by rising x, and unit vectors from there along
    # the edge that ends there and along the one that starts; inside is left of an edge
    corners: Float32Array


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceField:
    """Distances from an outline's edges, um, negative inside."""

    turn: tuple[float, float]  # cosine and sine of the outline's frame in the world
    origin_um: tuple[float, float]  # of that frame, in the world
    corner_um: tuple[float, float]  # of the grid's first point, in that frame
    grid: DistanceGrid

    @property
    def values(self) -> Float32Array:
        """Return the grid's distances, (rows, columns) um, y upwards."""
        return self.grid.values

    def at(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Return distances at the grid's points nearest to world points, (...) um."""
        return self.read(*self.places(x, y))

    def read(self, u: Float32Array, v: Float32Array) -> Float32Array:
        """Return the distances at `places`, or linear functions of them, (...) um."""
        column, row = self._nearest(u, v)
        row *= self.values.shape[1]
        row += column
        return self.values.ravel().take(row)

    def normal(
        self, x: Float32Array, y: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Return unit vectors outwards of the nearest edges at points, (...) um."""
        column, row = self._nearest(*self.places(x, y))
        rows, columns = self.values.shape
        left, right = np.maximum(column - 2, 0), np.minimum(column + 2, columns - 1)
        low, high = np.maximum(row - 2, 0), np.minimum(row + 2, rows - 1)
        values, first = self.values.ravel(), row * columns
        u = values.take(first + right) - values.take(first + left)
        v = values.take(high * columns + column) - values.take(low * columns + column)
        length = np.maximum(np.hypot(u, v), np.float32(1e-6))
        c, s = (np.float32(value) for value in self.turn)
        return (c * u - s * v) / length, (s * u + c * v) / length

    def places(
        self, x: Float32Array, y: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Return world points, (...) um, in the grid's steps, half a step on.

        Floors round then.
        """
        (c, s), (x0, y0) = self.turn, self.origin_um
        k = 1 / STEP_UM
        u, v = self.directions(x, y)
        u += np.float32(0.5 - k * (c * x0 + s * y0 + self.corner_um[0]))
        v += np.float32(0.5 - k * (c * y0 - s * x0 + self.corner_um[1]))
        return u, v

    def directions(
        self, x: Float32Array, y: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Return world vectors, (...) um, in the grid's steps."""
        c, s = (np.float32(value / STEP_UM) for value in self.turn)
        u, v = c * x, c * y
        u += s * y
        v -= s * x
        return u, v

    def _nearest(
        self, u: Float32Array, v: Float32Array
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Return the nearest column and row, at the rim for points beyond."""
        rows, columns = self.values.shape
        near = (_limit(u.copy(), columns - 1), _limit(v.copy(), rows - 1))
        column, row = (at.astype(np.int32) for at in near)
        return column, row


def _limit(at: Float32Array, most: float) -> Float32Array:
    """Return places limited to 0 and `most`, in place."""
    np.maximum(at, np.float32(0), out=at)
    return np.minimum(at, np.float32(most), out=at)


def distance_field(outline: Outline, area: Box) -> DistanceField | None:
    """Return distances from an outline's edges wherever an area lies.

    Parameters
    ----------
    outline : Outline
        In the world, um.
    area : (x_min, y_min, x_max, y_max)
        Where distances are wanted, um.

    Returns
    -------
    DistanceField or None
        None where the outline stays farther off than `BEYOND_UM`.
    """
    if not outline.rings:
        return None
    (c, s), (x0, y0), own = own_frame(outline)
    half = math.hypot(area[2] - area[0], area[3] - area[1]) / 2
    dx, dy = (area[0] + area[2]) / 2 - x0, (area[1] + area[3]) / 2 - y0
    u, v = c * dx + s * dy, c * dy - s * dx
    box = _wanted(_near(own), (u - half, v - half, u + half, v + half))
    if box is None:
        return None
    return DistanceField(
        turn=(c, s), origin_um=(x0, y0), corner_um=box[:2], grid=_kept(own, box)
    )


def even_distances(
    outline: Outline, corner_um: Point, step_um: float, shape: tuple[int, int]
) -> Float32Array:
    """Return distances from an outline's edges at points of a square lattice.

    Parameters
    ----------
    outline : Outline
        In the world, um; not empty.
    corner_um : (x, y)
        The first point; rows run down from there.
    step_um, shape
        Of the lattice.

    Returns
    -------
    (rows, columns) float32 array
        um, linear between the points of a grid; negative inside. Beyond `BEYOND_UM`
        from all edges they are that or more.
    """
    from microplan.optics.outline.even_reading import read_even  # loads a compiler

    x, y = corner_um
    rows, columns = shape
    area = (x, y - (rows - 1) * step_um, x + (columns - 1) * step_um, y)
    field = distance_field(outline, area)
    found = np.full(shape, BEYOND_UM, dtype=np.float32)
    if field is not None:
        (c, s), (x0, y0), (left, low) = field.turn, field.origin_um, field.corner_um
        x, y = x - x0, y - y0
        first = (c * x + s * y - left, c * y - s * x - low)
        read_even(field.values, STEP_UM, field.turn, first, step_um, found)
    return found


@lru_cache(maxsize=64)
def _near(key: OwnEdges) -> Box:
    """Return the box all about edges."""
    left, low, right, high = own_edges(key).bounds_um
    return left - BEYOND_UM, low - BEYOND_UM, right + BEYOND_UM, high + BEYOND_UM


def _wanted(near: Box, box: Box) -> Box | None:
    """Return the box of a grid: all about edges, or what a wanted box has of it.

    None where that is nothing.
    """
    even = [
        _EVEN_UM * (math.floor if k < 2 else math.ceil)(at / _EVEN_UM)
        for k, at in enumerate(box)
    ]
    met = (max(even[0], near[0]), max(even[1], near[1]),
           min(even[2], near[2]), min(even[3], near[3]))  # fmt: skip
    if met[0] >= met[2] or met[1] >= met[3]:
        return None
    points = (near[2] - near[0]) * (near[3] - near[1]) / STEP_UM**2
    return near if points <= _WHOLE else met


@lru_cache(maxsize=16)
def _kept(key: OwnEdges, box: Box) -> DistanceGrid:
    """Return the grid, from the rounded edges alone."""
    edges = own_edges(key)
    columns = math.ceil((box[2] - box[0]) / STEP_UM) + 1
    rows = math.ceil((box[3] - box[1]) / STEP_UM) + 1
    x: FloatArray = box[0] + STEP_UM * np.arange(columns, dtype=np.float64)
    y: FloatArray = box[1] + STEP_UM * np.arange(rows, dtype=np.float64)
    away = _distances(edges.segments, edges.arcs, x, y)
    inside = _inside(edges, box, rows, columns)
    values = np.where(inside, -away, away).astype(np.float32)
    values.setflags(write=False)
    return DistanceGrid(values, _corners(edges, box))


def _corners(edges: EdgeArrays, box: Box) -> Float32Array:
    """Return the corners of a grid, as it has them."""
    lines, arcs = edges.segments, edges.arcs
    # an edge that is a point has no way of its own
    lines = lines[np.hypot(*(lines[:, 2:] - lines[:, :2]).T) > _POINT_UM]
    arcs = arcs[np.abs(arcs[:, 2] * arcs[:, 4]) > _POINT_UM]
    if not len(lines) + len(arcs):
        return np.empty((6, 0), dtype=np.float32)
    starts, out = _ways(lines, lines[:, :2], arcs, arcs[:, 3])
    ends, into = _ways(lines, lines[:, 2:], arcs, arcs[:, 3] + arcs[:, 4])
    out = out[cKDTree(starts).query(ends)[1]]
    found = np.hstack([(ends - box[:2]) / STEP_UM, -into, out])
    found = found[(into * out).sum(axis=1) < _CORNER]
    return np.asarray(found[np.argsort(found[:, 0])].T, dtype=np.float32)


def _ways(
    lines: FloatArray, at: FloatArray, arcs: FloatArray, angle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ends of edges, at points and angles, and unit vectors along them there."""
    along = lines[:, 2:] - lines[:, :2]
    along /= np.hypot(*along.T)[:, None]
    c, s = np.cos(angle), np.sin(angle)
    places = arcs[:, :2] + arcs[:, 2:3] * np.stack([c, s], axis=1)
    turning = np.sign(arcs[:, 4:]) * np.stack([-s, c], axis=1)
    return np.vstack([at, places]), np.vstack([along, turning])


def _distances(
    lines: FloatArray, arcs: FloatArray, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return the distance of (rows, columns) points to the nearest edge, um.

    By tiles: each of the edges that may be the nearest somewhere in it.
    """
    found = np.empty((y.size, x.size))
    across, down = (
        [slice(first, first + _TILE) for first in range(0, at.size, _TILE)]
        for at in (x, y)
    )
    middles = (np.array([x[t].mean() for t in across]),
               np.array([y[t].mean() for t in down]))  # fmt: skip
    away = np.stack(list(_by_edge(lines, arcs, *middles)))
    near = away <= away.min(axis=0) + math.sqrt(2) * _TILE * STEP_UM
    for (i, rows), (j, columns) in product(enumerate(down), enumerate(across)):
        line, arc = np.split(near[:, i, j], [len(lines)])
        each = _by_edge(lines[line], arcs[arc], x[columns], y[rows])
        found[rows, columns] = reduce(np.minimum, each)
    return found


def _by_edge(
    lines: FloatArray, arcs: FloatArray, x: FloatArray, y: FloatArray
) -> Iterator[FloatArray]:
    """Yield the distances of (rows, columns) points to each edge, um."""
    for x0, y0, x1, y1 in lines:
        dx, dy = x1 - x0, y1 - y0
        px, py = x - x0, (y - y0)[:, None]
        t = np.clip((px * dx + py * dy) / max(dx * dx + dy * dy, 1e-30), 0.0, 1.0)
        yield np.hypot(px - t * dx, py - t * dy)
    for cx, cy, radius, start, sweep in arcs:
        px, py = x - cx, (y - cy)[:, None]
        round_ = np.abs(np.hypot(px, py) - radius)
        if abs(sweep) < 2 * math.pi - 1e-9:
            after = np.mod((np.arctan2(py, px) - start) * np.sign(sweep), 2 * math.pi)
            ends = [
                np.hypot(px - radius * math.cos(a), py - radius * math.sin(a))
                for a in (start, start + sweep)
            ]
            round_ = np.where(after <= abs(sweep), round_, np.minimum(*ends))
        yield round_


def _inside(edges: EdgeArrays, box: Box, rows: int, columns: int) -> BoolArray:
    """Return whether points lie inside, (rows, columns), y upwards."""
    top_um = box[1] + (rows - 0.5) * STEP_UM
    covered = cells(edges, box[0] - STEP_UM / 2, top_um, STEP_UM, (rows, columns))
    return np.asarray(covered[::-1] > 0.5)
