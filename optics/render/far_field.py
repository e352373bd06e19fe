"""Far-field correction of a small tile by light from beyond it.

Repetitions and cuts of an outline nearer than the margin wanted leave an error in a
tile's image. At the pixels seen it has no detail finer than their distance, so low
orders on the small tile and on one with the whole margin give it. This is the splitting
of Ewald (1921), Ann. Phys. 369, 253, between two periods instead of two spaces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import EdgeArrays
from microplan.optics.render.pixels import PixelTile, to_world
from microplan.optics.render.pruned_ifft import Factors, waves_at, weigh
from microplan.optics.render.sampling import Quadrant, pixel_gain
from microplan.optics.render.spectrum import Spectrum, spectrum
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import RadialTable

# The low orders end like 1 - (1 - exp(-q))**2, q = (f / s)**2 / 2. The kink of the
# transfer at 0 becomes one in f**5, so what is left falls like r**-7, and s = 7 / (2 pi
# r) was seen to leave least: 1e-5 for an edge r = 10 wavelengths / A away.
_STEEPNESS = 7.0
# Share of an order that is left out: 1e-5 was no better, 1e-3 by 1e-5 worse.
_LOWEST = 1e-4
# The correction is a polynomial on the pixels seen. Its terms fall by the distance of
# its sources; at most 1e-2 at first, they end below 1e-6.
_FALL = 1e4
_EXTRA = 4  # terms, for the factor before the fall


@dataclass(frozen=True, slots=True, kw_only=True)
class Low:
    """The low orders of an outline's spectrum on one tile."""

    tile: PixelTile
    spectrum: Spectrum  # each order by its share in the correction
    quadrant: Quadrant

    @classmethod
    def of(
        cls, tile: PixelTile, found: Spectrum, microscope: Microscope, reach_um: float
    ) -> Self:
        """Weigh the orders that are low for a distance."""
        low = found.cut(highest_per_um(reach_um))
        share = _share(low, reach_um)
        orders = Quadrant.of(low.tile, low.orders, microscope.cutoff_per_um)
        return cls(
            tile=tile,
            spectrum=Spectrum(tile=low.tile, values=low.values * share),
            quadrant=orders,
        )

    def image(
        self,
        table: RadialTable,
        setting: Microscope,
        cut_per_um: float,
        places: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Return the image at rows (R,) and columns (C,), px; (R, C)."""
        x, y = self.tile.columns, self.tile.rows
        orders = self.spectrum.within(cut_per_um)
        gain = self.quadrant.gain(table, orders)
        across, along = pixel_gain(setting, self.spectrum.tile, orders)
        np.multiply(gain, across, out=gain)
        np.multiply(gain, along[:, None], out=gain)
        weighed = weigh(self.spectrum.values, gain)
        up = (y.start + y.count - 1 - places[0]) / y.count
        found = waves_at(weighed, up, (places[1] - x.start) / x.count)
        return np.asarray(found, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Far:
    """What a small tile's image lacks, and what it has too much."""

    near: Low
    wide: Low
    reach_px: float  # from the pixels seen to what the small tile has wrong

    def change(
        self,
        table: RadialTable,
        setting: Microscope,
        cut_per_um: float,
        rows: FloatArray,
        columns: FloatArray,
    ) -> Factors:
        """Return the correction at even rows (R,) and columns (C,) of pixels.

        Parameters
        ----------
        table : RadialTable
            The transfer up to `cut_per_um`.
        setting : Microscope
            The setting whose pixels average the image.
        cut_per_um : float
            Highest frequency of the image, cycles/um.
        rows, columns : float arrays
            Positions, px of the frame as prepared, a step apart.

        Returns
        -------
        (R, n), (n, C) float64 arrays
            Factors of the correction.
        """
        down, right = (_terms(axis, self.reach_px) for axis in (rows, columns))
        nodes = _nodes(rows, down), _nodes(columns, right)
        there = self.wide.image(table, setting, cut_per_um, nodes)
        there -= self.near.image(table, setting, cut_per_um, nodes)
        left = _polynomials(rows.size, down)
        return left, there @ _polynomials(columns.size, right).T


def highest_per_um(reach_um: float) -> float:
    """Return the highest frequency of a correction, cycles/um."""
    width = _STEEPNESS / (2 * math.pi * reach_um)
    return width * math.sqrt(2 * math.log(2 / _LOWEST))


def make_far(
    edges: EdgeArrays,
    microscope: Microscope,
    near: tuple[PixelTile, Spectrum],
    wide: PixelTile,
    *,
    reach_um: float,
    shift_um: tuple[float, float],
    single: bool = False,
) -> Far:
    """Return the correction of a small tile by a wide one.

    Parameters
    ----------
    near : (PixelTile, Spectrum)
        The small tile with its spectrum.
    wide : PixelTile
        The tile with all of the margin.
    reach_um : float
        Distance from the pixels seen to cuts and repetitions of the small tile.
    shift_um : (x, y)
        Displacement of the image.
    single : bool
        Whether to transform in single precision,
        `microplan.optics.render.sampling.SINGLE_ERROR`.
    """
    world, box = to_world(wide, microscope, shift_um)
    top = min(highest_per_um(reach_um), microscope.cutoff_per_um)
    # a tile of one value has no orders, but the low ones of the other are still wanted
    found = spectrum(edges, world, top, box=box, single=single)
    return Far(
        near=Low.of(near[0], near[1], microscope, reach_um),
        wide=Low.of(wide, found, microscope, reach_um),
        reach_px=reach_um * microscope.px_per_um,
    )


def _share(low: Spectrum, reach_um: float) -> FloatArray:
    """Return how much of each order is low, (2 K + 1, J + 1)."""
    J, K = low.orders
    width = _STEEPNESS / (2 * math.pi * reach_um)
    u = np.arange(J + 1) / (low.tile.width_um * width)
    v = np.arange(K + 1) / (low.tile.height_um * width)
    share = 1 - np.expm1(-(u**2 + v[:, None] ** 2) / 2) ** 2
    return np.concatenate([share, share[:0:-1]])


def _terms(places: FloatArray, reach_px: float) -> int:
    """Return how many terms a polynomial over even positions needs."""
    half = (places[-1] - places[0]) / 2
    if half == 0:
        return 1
    # the ellipse about the pixels that reaches to the nearest source
    axis = 1 + reach_px / half
    fall = math.log(axis + math.sqrt(axis**2 - 1))
    return math.ceil(math.log(_FALL) / fall) + _EXTRA


def _nodes(places: FloatArray, terms: int) -> FloatArray:
    """Return Chebyshev's points of the interval that even positions cover."""
    low, high = places[0], places[-1]
    nodes: FloatArray = (low + high) / 2 + (high - low) / 2 * _points(terms)
    return nodes


def _points(terms: int) -> FloatArray:
    """Return the zeros of a Chebyshev polynomial, (terms,)."""
    points: FloatArray = np.cos(np.pi * (np.arange(terms) + 0.5) / terms)
    return points


@lru_cache(maxsize=64)
def _polynomials(count: int, terms: int) -> FloatArray:
    """Return values at even positions by those at Chebyshev's points, (count, N)."""
    inverse = np.polynomial.chebyshev.chebvander(_points(terms), terms - 1).T
    inverse *= 2 / terms
    inverse[0] /= 2
    even = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    found: FloatArray = np.polynomial.chebyshev.chebvander(even, terms - 1) @ inverse
    found.setflags(write=False)
    return found
