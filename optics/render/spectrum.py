"""Fourier transforms of outlines inside a band of frequencies.

The transform of an outline is a boundary integral (divergence theorem), so Gauss nodes
on the segments and arcs are all that is needed of it: no pixels, no polygons.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from microplan.arrays import Box, ComplexArray, FloatArray
from microplan.optics.outline.clip import EdgeArrays, clip, to_edges
from microplan.optics.outline.outline import Outline
from microplan.optics.render.nufft_gridding import (
    deposit,
    grid_size,
    kernel_transforms,
    kernel_weights,
)
from microplan.optics.transfer.lru import Recent

Coefficients = npt.NDArray[np.complex64] | npt.NDArray[np.complex128]

# Nodes n of Gauss's rules, and half the phase, rad, that they integrate to 1e-8 on a
# line (tested).
RULES = (
    *((2, 0.04), (4, 0.7), (6, 2.2), (8, 4.2), (12, 9.2), (16, 14.9)),
    *((20, 21.0), (24, 27.4), (28, 34.0), (32, 40.0)),
)
_NODES = tuple(np.polynomial.legendre.leggauss(size) for size, _ in RULES)
_LIMITS = np.array([limit for _, limit in RULES])


# Looks ask for the same layers at several heights and with other layers.
_RECENT_BYTES = 1 << 26


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """The period of a spectrum: a rectangle, um, y up."""

    left_um: float
    bottom_um: float
    width_um: float
    height_um: float

    def __post_init__(self) -> None:
        if not (self.width_um > 0 and self.height_um > 0):
            raise ValueError(f"a tile needs a positive width and height, got {self}")

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Return (x_min, y_min, x_max, y_max), um."""
        right, top = self.left_um + self.width_um, self.bottom_um + self.height_um
        return (self.left_um, self.bottom_um, right, top)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrum:
    """Fourier coefficients of a periodic 0/1 indicator on a tile.

    `values[k, j]` belongs to exp(2 pi i (j X + k Y)), X and Y in tiles from the lower
    left corner, j = 0..J and k = 0..K, -K..-1. `values[0, 0]` is the covered share.
    """

    tile: Tile
    values: Coefficients  # (2 K + 1, J + 1)

    @property
    def orders(self) -> tuple[int, int]:
        """Return (J, K), the highest orders along x and y."""
        return (self.values.shape[1] - 1, self.values.shape[0] // 2)

    def within(self, f_per_um: float) -> tuple[int, int]:
        """Return the highest orders along x and y up to a frequency, cycles/um."""
        J, K = self.orders
        j, k = band_orders(self.tile, f_per_um)
        return min(j, J), min(k, K)

    def cut(self, f_per_um: float) -> Spectrum:
        """Return the part of the coefficients up to a frequency, cycles/um."""
        J, K = self.orders
        j, k = self.within(f_per_um)
        if (j, k) == (J, K):
            return self
        rows = np.r_[0 : k + 1, 2 * K + 1 - k : 2 * K + 1]
        return Spectrum(tile=self.tile, values=self.values[rows, : j + 1])


_RECENT: Recent[Spectrum] = Recent(_RECENT_BYTES, lambda found: found.values.nbytes)


def band_orders(tile: Tile, f_per_um: float) -> tuple[int, int]:
    """Return the highest orders along x and y up to a frequency, cycles/um."""
    return (math.floor(f_per_um * tile.width_um), math.floor(f_per_um * tile.height_um))


def spectrum(
    outline: Outline | EdgeArrays,
    tile: Tile,
    cut_per_um: float,
    *,
    box: Box | None = None,
    single: bool = False,
) -> Spectrum:
    """Return the Fourier coefficients of an outline, repeated tile by tile.

    Parameters
    ----------
    cut_per_um : float
        Highest radial frequency, cycles/um; the corners beyond it are filled, badly.
    box : (x_min, y_min, x_max, y_max), optional
        Where the outline is cut off, by default at the tile. Beyond the tile it would
        come in again from the other side.
    single : bool
        Whether to transform in single precision,
        `microplan.optics.render.sampling.SINGLE_ERROR`.

    Returns
    -------
    Spectrum
        A single coefficient where the tile is covered or empty. Else within
        `microplan.optics.render.nufft_gridding.KERNEL_ERROR` times the perimeter over 2
        pi tile heights of the exact coefficients.

    Raises
    ------
    ValueError
        If `cut_per_um` is negative or not finite.

    References
    ----------
    Boundary form: Chu & Huang (1989), J. Opt. Soc. Am. A 6, 1653. Spreading: Jackson
    et al. (1991), IEEE Trans. Med. Imaging 10, 473, with the kernel of Beatty et al.
    (2005), IEEE Trans. Med. Imaging 24, 799.
    """
    if not (cut_per_um >= 0 and math.isfinite(cut_per_um)):
        raise ValueError(f"cut_per_um must be finite and >= 0, got {cut_per_um}")
    edges = outline if isinstance(outline, EdgeArrays) else to_edges(outline)
    asked = (edges.segments.tobytes(), edges.arcs.tobytes(), tile, cut_per_um, box)
    return _RECENT.get(
        (*asked, single),
        lambda: _transformed(
            clip(edges, box or tile.box), tile, cut_per_um, single=single
        ),
    )


def _transformed(
    edges: EdgeArrays, tile: Tile, cut_per_um: float, *, single: bool
) -> Spectrum:
    """Return the coefficients of edges within a tile, not to be changed."""
    share = edges.area_um2 / (tile.width_um * tile.height_um)
    if abs(share) < 1e-12 or abs(share - 1) < 1e-12:  # nothing, or all of the tile
        return Spectrum(tile=tile, values=np.full((1, 1), round(share) + 0j))
    J, K = band_orders(tile, cut_per_um)
    shape = 2 * K + 1, J + 1
    values: Coefficients = np.empty(shape, dtype=np.complex128)
    if single:
        values = np.empty(shape, dtype=np.complex64)
    _fill(values, boundary_nodes(edges, cut_per_um), tile)
    values[0, 0] = share
    values.setflags(write=False)
    return Spectrum(tile=tile, values=values)


def boundary_nodes(
    edges: EdgeArrays, f_per_um: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return quadrature nodes of boundary integrals of waves up to a frequency.

    Parameters
    ----------
    f_per_um : float
        Highest radial frequency of the integrand, cycles/um.

    Returns
    -------
    x, y, dx, dy : (N,) float64 arrays
        Points on the boundary and the boundary vectors they represent, um.
    """
    parts = [_line_nodes(edges.segments, f_per_um), _arc_nodes(edges.arcs, f_per_um)]
    x, y, dx, dy = (np.concatenate(column) for column in zip(*parts, strict=True))
    return x, y, dx, dy


Nodes = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _line_nodes(segments: FloatArray, f_per_um: float) -> Nodes:
    """Place nodes on segments (S, 4)."""
    x0, y0, x1, y1 = segments.T
    half = np.pi * f_per_um * np.hypot(x1 - x0, y1 - y0)
    index, t, weight = _panels(half, np.ones(half.shape, dtype=np.intp))
    dx, dy = (x1 - x0)[index], (y1 - y0)[index]
    return x0[index] + t * dx, y0[index] + t * dy, weight * dx, weight * dy


def _arc_nodes(arcs: FloatArray, f_per_um: float) -> Nodes:
    """Place nodes on arcs (M, 5)."""
    cx, cy, radius, start, sweep = arcs.T
    # Along an arc the phase is not linear: its harmonics reach 8 beyond 2 pi f r before
    # they are 1e-8, and only panels of a radian keep the phase close to a line.
    half = (np.pi * f_per_um * radius + 4) * np.abs(sweep)
    index, t, weight = _panels(half, np.ceil(np.abs(sweep)).astype(np.intp))
    angle = start[index] + t * sweep[index]
    c, s, r = np.cos(angle), np.sin(angle), radius[index]
    turn = weight * sweep[index] * r
    return cx[index] + r * c, cy[index] + r * s, -s * turn, c * turn


def _panels(
    half: FloatArray, least: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], FloatArray, FloatArray]:
    """Choose Gauss rules for edges of half phase (E,), rad, `least` panels an edge.

    Returns for each node its edge, its position 0..1 along it and its weight, (N,)
    each.
    """
    if not half.size:
        return np.empty(0, np.intp), np.empty(0), np.empty(0)
    count = np.maximum(np.ceil(half / _LIMITS[-1]).astype(np.intp), least)
    found, places, weights = [np.empty(0, np.intp)], [np.empty(0)], [np.empty(0)]
    rule = np.minimum(np.searchsorted(_LIMITS, half / count), _LIMITS.size - 1)
    for which in np.flatnonzero(np.bincount(rule)).tolist():
        nodes, weight = _NODES[which]
        pick = np.flatnonzero(rule == which)
        edge = np.repeat(pick, count[pick])
        first = np.cumsum(count[pick]) - count[pick]
        panel = np.arange(edge.size) - np.repeat(first, count[pick])
        share = 1 / count[edge][:, None]
        found.append(np.repeat(edge, nodes.size))
        places.append(((panel[:, None] + (1 + nodes) / 2) * share).ravel())
        weights.append((weight / 2 * share).ravel())
    return np.concatenate(found), np.concatenate(places), np.concatenate(weights)


def _runs(rows: npt.NDArray[np.intp], count: int) -> Iterator[tuple[int, int]]:
    """Yield first and end of the runs of rows 0..count - 1 that are named."""
    named = np.zeros(count + 2, dtype=np.int8)
    named[rows.ravel() + 1] = 1
    ends = np.flatnonzero(np.diff(named))
    yield from zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True)


def _fill(values: Coefficients, nodes: Nodes, tile: Tile) -> None:
    """Write all coefficients but the mean into `values` (2 K + 1, J + 1)."""
    x, y, dx, dy = nodes
    J, K = values.shape[1] - 1, values.shape[0] // 2
    X = (x - tile.left_um) / tile.width_um
    Y = (y - tile.bottom_um) / tile.height_um
    gx, gy = grid_size(J), grid_size(K)
    at_x, share_x = kernel_weights(X, gx)
    at_y, share_y = kernel_weights(Y, gy)
    level = kernel_transforms(K, gy)
    level = np.concatenate([level, level[:0:-1]])
    if J > 0:
        j = np.arange(1, J + 1)
        slope = 1j / (2 * np.pi * j * kernel_transforms(J, gx)[1:])
        slope = slope.astype(values.dtype)
        grid = deposit(at_x, share_x, at_y, share_y, dy / tile.height_um, (gy, gx))
        kind = np.float32 if values.dtype == np.complex64 else np.float64
        half = np.zeros((gy, J), dtype=values.dtype)
        for first, end in _runs(at_y, gy):  # rows that edges touch
            along = fft.rfft(grid[first:end].astype(kind, copy=False), axis=1)
            np.multiply(along[:, 1 : J + 1], slope, out=half[first:end])
        lines = fft.fft(half, axis=0, overwrite_x=True)
        inverse = (1 / level[:, None]).astype(kind)
        np.multiply(lines[: K + 1], inverse[: K + 1], out=values[: K + 1, 1:])
        np.multiply(lines[gy - K :], inverse[K + 1 :], out=values[K + 1 :, 1:])
    if K > 0:  # along u = 0 the field must point along y
        weights = share_y * (dx / tile.width_um)[:, None]
        line = np.bincount(at_y.ravel(), weights=weights.ravel(), minlength=gy)
        values[1:, 0] = _mean_column(np.asarray(line, dtype=np.float64), level)


def _mean_column(line: FloatArray, level: FloatArray) -> ComplexArray:
    """Return orders 1..K, -K..-1 along y from gridded dx (N,) and kernel (2 K + 1,)."""
    K = level.size // 2
    waves, k = fft.fft(line), np.arange(1, K + 1)
    k = np.concatenate([k, -k[::-1]])
    waves = np.concatenate([waves[1 : K + 1], waves[line.size - K :]])
    column: ComplexArray = waves / level[1:] * -1j / (2 * np.pi * k)
    return column
