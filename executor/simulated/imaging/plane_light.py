"""Light of one region of a plane: points where it bends, more of them at edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, Box, FloatArray, IntArray
from microplan.executor.simulated.imaging.rays.lattice import (
    PointLattice,
    filled,
    lattice_over,
    widened,
)
from microplan.executor.simulated.imaging.rays.marching import Reals32
from microplan.executor.simulated.imaging.rays.regions import PlaneRegion

SPARSE = 4  # points of the lattice from one that is always computed to the next
REACH = 2.5  # spacings outside a region in which points are drawn into it
BORDER_UM = 5.0  # in a border's reach light is not left to the sparse points
GROWN = 3  # rounds of neighbours of points where light bends

_Reals = TypeVar("_Reals", npt.NDArray[np.float64], npt.NDArray[np.float32])
Seen = Callable[[FloatArray, FloatArray], Reals32]  # (N, directions) at (N,) points


@dataclass(frozen=True, eq=False)
class RegionLight:
    """Light in a region, continued beyond its border."""

    lattice: PointLattice
    sparse: Reals32  # (rows, columns, directions), at each `SPARSE`th point
    points: tuple[tuple[IntArray, IntArray, Reals32], ...]  # (N,) and (N, directions)
    flat: FloatArray  # (rows, columns), mean of directions on the lattice
    added: FloatArray  # (Y, X), on a finer lattice: what the mean bends by between
    finer: PointLattice

    def mean(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the mean of directions, (Y, X) shares of 1, on a grid of um."""
        whole = self.lattice.smooth(self.flat, x, y)
        if self.added.any():
            whole += self.finer.straight(self.added, x, y)
        return whole

    def dense(self) -> Reals32:
        """Return light at all points of the lattice, (rows, columns, directions)."""
        light = self.sparse
        for row, column, found in self.points:
            light = _between(light)
            light[row, column] = found
        return light


def plane_lattice(box: Box, spacing_um: float) -> PointLattice:
    """Return a lattice over a box that sparse points begin and end."""
    found = lattice_over(box, spacing_um)
    across, down = (
        along[0] + spacing_um * np.arange(-(-(len(along) - 1) // SPARSE) * SPARSE + 1)
        for along in (found.x_um, found.y_um)
    )
    return PointLattice(x_um=across, y_um=down, spacing_um=spacing_um)


def region_light(
    region: PlaneRegion,
    lattice: PointLattice,
    seen: Seen,
    directions: int,
    *,
    tolerance: float,
    edge_um: float,
) -> RegionLight:
    """Return the light of a region from points that halve until it is straight.

    Parameters
    ----------
    region : PlaneRegion
        Where.
    lattice : PointLattice
        On which light is known by direction, of `plane_lattice`.
    seen : function
        Radiance at points of the region, (N, directions) at (N,) um.
    directions : int
        How many.
    tolerance : float
        Share of full scale by which a point may differ from the straight line between
        its neighbours without more points beside it.
    edge_um : float
        The mean is followed to points so far apart, where it bends.
    """
    shape = (len(lattice.y_um), len(lattice.x_um))
    px, py = (v.reshape(shape) for v in lattice.points())
    away = region.distance(px.ravel(), py.ravel()).reshape(shape)
    points = _RegionPoints(region, seen, tolerance)
    known = away[::SPARSE, ::SPARSE] < REACH * SPARSE * lattice.spacing_um
    sparse: Reals32 = np.zeros((*known.shape, directions), dtype=np.float32)
    row, column = np.nonzero(known)
    found, good = points.at(
        px[::SPARSE, ::SPARSE][known], py[::SPARSE, ::SPARSE][known]
    )
    known[row[~good], column[~good]] = False
    sparse[known] = found
    sparse = filled(sparse, known)
    flat = sparse.mean(axis=2, dtype=float)
    bent = _curved(flat, 2 * tolerance) & known
    stride, made = SPARSE, []
    while stride > 1:
        stride //= 2
        flat = _between(flat)
        reach = away[::stride, ::stride] < REACH * stride * lattice.spacing_um
        ask = _children(bent)
        if stride > 1:
            ask |= np.abs(away[::stride, ::stride]) < BORDER_UM
        there = (px[::stride, ::stride], py[::stride, ::stride])
        bent, row, column, found = points.refine(flat, there, ask & reach)
        made.append((row, column, found))
    added, finer = np.zeros(shape), lattice
    if bent.any() and edge_um < lattice.spacing_um:
        added, finer = _added(points, lattice, flat, bent, edge_um)
    return RegionLight(lattice, sparse, tuple(made), flat, added, finer)


def _added(
    points: _RegionPoints,
    lattice: PointLattice,
    flat: FloatArray,
    bent: BoolArray,
    edge_um: float,
) -> tuple[FloatArray, PointLattice]:
    """Return what the mean differs by on a finer lattice, and the lattice."""
    added, finer = np.zeros_like(flat), lattice
    while finer.spacing_um > 1.01 * edge_um and bent.any():
        finer = finer.finer(2)
        base = lattice.smooth(flat, finer.x_um, finer.y_um)
        whole = _between(added) + base
        x, y = np.meshgrid(finer.x_um, finer.y_um)
        ask = _children(bent)
        if finer.spacing_um > 0.4 * lattice.spacing_um:  # a cubic swings beside a step
            ask = widened(ask)
        bent = points.refine(whole, (x, y), points.near(x, y, ask))[0]
        added = whole - base
    return added, finer


@dataclass(frozen=True, eq=False)
class _RegionPoints:
    """What is seen at points of a region."""

    region: PlaneRegion
    seen: Seen
    tolerance: float

    def at(self, x: FloatArray, y: FloatArray) -> tuple[Reals32, BoolArray]:
        """Return light at those of (N,) um points that get into the region, and which.

        (M, directions), (N,) bool.
        """
        qx, qy, good = self.region.drawn_in(x, y)
        if not good.any():
            return np.zeros((0, 1), dtype=np.float32), good
        return self.seen(qx[good], qy[good]), good

    def refine(
        self, flat: FloatArray, there: tuple[FloatArray, FloatArray], ask: BoolArray
    ) -> tuple[BoolArray, IntArray, IntArray, Reals32]:
        """Compute points where asked, and beside where light bends.

        Parameters
        ----------
        flat : (rows, columns) float array
            Mean of directions, exact at every second row and column; what is computed
            is put in.
        there : two (rows, columns) float arrays
            Points, um.
        ask : (rows, columns) bool array
            Where.

        Returns
        -------
        (rows, columns) bool array of where light bends; rows, columns, (N,), and light,
        (N, directions), of the points computed.
        """
        x, y = there
        known = np.zeros(ask.shape, dtype=bool)
        known[::2, ::2] = True
        bent = np.zeros(ask.shape, dtype=bool)
        none = np.zeros(0, dtype=np.intp)
        made = [(none, none, np.zeros((0, 1), dtype=np.float32))]
        for _ in range(GROWN):
            row, column = np.nonzero(ask & ~known)
            if not len(row):
                break
            known |= ask
            found, good = self.at(x[row, column], y[row, column])
            row, column = row[good], column[good]
            if not len(row):
                break
            made.append((row, column, found))
            mean = found.mean(axis=1, dtype=float)
            far = np.abs(mean - flat[row, column]) > self.tolerance
            flat[row, column] = mean
            bent[row[far], column[far]] = True
            ask = self.near(x, y, widened(bent))
        made = made[1:] or made
        rows, columns, light = (
            np.concatenate(each) for each in zip(*made, strict=True)
        )
        return bent, rows, columns, light

    def near(self, x: FloatArray, y: FloatArray, ask: BoolArray) -> BoolArray:
        """Return which of the points asked for are in the region or just outside it."""
        row, column = np.nonzero(ask)
        near = np.zeros(ask.shape, dtype=bool)
        away = self.region.distance(x[row, column], y[row, column])
        near[row, column] = away < REACH * float(x[0, 1] - x[0, 0])
        return near


def _curved(mean: FloatArray, most: float) -> BoolArray:
    """Return where (rows, columns) values bend, or are beside such."""
    bent = np.zeros(mean.shape, dtype=bool)
    for axis in (0, 1):
        second = np.abs(np.diff(mean, 2, axis=axis)) > most
        wide = [(1, 1), (0, 0)] if axis == 0 else [(0, 0), (1, 1)]
        bent |= np.pad(second, wide)
    return widened(bent)


def _children(bent: BoolArray) -> BoolArray:
    """Return the points between a point that bends and its neighbours, finer by two."""
    rows, columns = bent.shape
    finer = np.zeros((2 * rows - 1, 2 * columns - 1), dtype=bool)
    finer[::2, ::2] = bent
    return widened(finer)


def _between(values: _Reals) -> _Reals:
    """Return (rows, columns, ...) values with the means between neighbours put in."""
    rows, columns = values.shape[:2]
    shape = (2 * rows - 1, 2 * columns - 1, *values.shape[2:])
    finer = np.empty(shape, values.dtype)
    finer[::2, ::2] = values
    finer[1::2, ::2] = (values[1:] + values[:-1]) / 2
    finer[:, 1::2] = (finer[:, 2::2] + finer[:, :-1:2]) / 2
    return finer
