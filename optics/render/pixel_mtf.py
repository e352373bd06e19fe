"""The transfer at all frequencies of a tile, on one quadrant: it is even in both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.render.pruned_ifft import Samples
from microplan.optics.render.spectrum import Tile
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import RadialTable

_AT_ONCE = 1 << 14  # orders read at once: their cubics stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class Quadrant:
    """Places in radial tables of the orders 0..K, 0..J of a tile."""

    places: FloatArray  # (K + 1, J + 1) sqrt(1 - x); -1 beyond the cutoff

    @classmethod
    def of(cls, tile: Tile, orders: tuple[int, int], cutoff_per_um: float) -> Self:
        """Return the quadrant up to the highest orders (J, K)."""
        u = np.arange(orders[0] + 1) / (tile.width_um * cutoff_per_um)
        v = np.arange(orders[1] + 1) / (tile.height_um * cutoff_per_um)
        places = u**2 + v[:, None] ** 2
        np.subtract(1, np.sqrt(places, out=places), out=places)
        beyond = places < 0
        np.sqrt(np.maximum(places, 0, out=places), out=places)
        places[beyond] = -1
        return cls(places=places)

    def gain(
        self, table: RadialTable, orders: tuple[int, int], *, single: bool = False
    ) -> Samples:
        """Return a transfer up to orders (J, K).

        Parameters
        ----------
        table : RadialTable
            The transfer.
        orders : (J, K)
            At most those of the quadrant.
        single : bool
            Whether the cubics are evaluated in single precision: 2e-7 off.

        Returns
        -------
        (K + 1, J + 1) float array
            As `table.read`, but 0 beyond the table's largest frequency.
        """
        J, K = orders
        cubics: Samples = _cubics(table)
        if single:
            cubics = cubics.astype(np.float32)
        found: Samples = np.empty((K + 1, J + 1), dtype=cubics.dtype)
        step = max(1, _AT_ONCE // (J + 1))
        for first in range(0, K + 1, step):
            part = slice(first, min(first + step, K + 1))
            # below the table there is one step of zeros
            t = self.places[part, : J + 1] * (1 / table.step)
            t += 1 - table.first / table.step
            _read(cubics, np.maximum(t, 0, out=t), found[part])
        return found


def _read(cubics: Samples, t: FloatArray, out: Samples) -> None:
    """Write cubics (N, 4) at places t >= 0 in steps into `out`, same shape as t.

    From the double's place: a single one would blur the phase of large defocus.
    """
    i = t.astype(np.intp)
    np.minimum(i, len(cubics) - 1, out=i)
    rest = np.subtract(t, i, out=t).astype(out.dtype)
    mine = cubics.take(i, axis=0)
    np.multiply(mine[..., 0], rest, out=out)
    for power in (1, 2):
        np.add(out, mine[..., power], out=out)
        np.multiply(out, rest, out=out)
    np.add(out, mine[..., 3], out=out)


def pixel_gain(
    microscope: Microscope, tile: Tile, orders: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return what a pixel's area does to orders along x (J + 1,) and y (K + 1,)."""
    side = microscope.um_per_px * math.sqrt(microscope.fill_factor)
    across = np.sinc(np.arange(orders[0] + 1) / tile.width_um * side)
    along = np.sinc(np.arange(orders[1] + 1) / tile.height_um * side)
    return across, along


def _cubics(table: RadialTable) -> FloatArray:
    """Return (N + 1, 4) cubics by shares of a step, zeros for one before the first."""
    steps = np.zeros((table.pieces.shape[1] + 1, 4))
    np.multiply(table.pieces.T, table.step ** np.arange(3, -1, -1), out=steps[1:])
    return steps
