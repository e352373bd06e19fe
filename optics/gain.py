"""The transfer at all frequencies of a tile, on one quadrant: it is even in both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from optics.folding import Samples
from optics.microscope import Microscope
from optics.models import RadialTable
from optics.spectrum import Tile

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quadrant:
    """Places in radial tables of the orders 0..K, 0..J of a tile."""

    places: FloatArray  # (K + 1, J + 1) sqrt(1 - x); -1 beyond the cutoff

    @classmethod
    def of(cls, tile: Tile, orders: tuple[int, int], cutoff_per_um: float) -> Self:
        """Return the quadrant up to the highest orders (J, K)."""
        u = np.arange(orders[0] + 1) / (tile.width_um * cutoff_per_um)
        v = np.arange(orders[1] + 1) / (tile.height_um * cutoff_per_um)
        below = 1 - np.sqrt(u**2 + v[:, None] ** 2)
        places = np.where(below < 0, -1.0, np.sqrt(np.maximum(below, 0)))
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
        kind = np.float32 if single else np.float64
        pieces = _steps(table).astype(kind)
        t = self.places[: K + 1, : J + 1] - table.first
        t *= 1 / table.step
        t += 1  # below the table there is one step of zeros
        np.clip(t, 0, pieces.shape[1], out=t)
        i = np.minimum(t.astype(np.int32), pieces.shape[1] - 1)
        # from the double's place: a single one would blur the phase of large defocus
        rest = np.subtract(t, i).astype(kind)
        value: Samples = pieces[0].take(i)
        for coefficients in pieces[1:]:
            value *= rest
            value += coefficients.take(i)
        return value


def pixel_gain(
    microscope: Microscope, tile: Tile, orders: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return what a pixel's area does to orders along x (J + 1,) and y (K + 1,)."""
    side = microscope.um_per_px * math.sqrt(microscope.fill_factor)
    across = np.sinc(np.arange(orders[0] + 1) / tile.width_um * side)
    along = np.sinc(np.arange(orders[1] + 1) / tile.height_um * side)
    return across, along


def _steps(table: RadialTable) -> FloatArray:
    """Return the cubics by shares of a step, zeros for one step before the first."""
    powers = table.step ** np.arange(3, -1, -1)
    pieces = table.pieces * powers[:, None]
    return np.concatenate([np.zeros((4, 1)), pieces], axis=1)
