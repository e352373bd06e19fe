"""Pictures of one even field added up, each held against the first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import VectorEstimate, jackknife_vector

_TILES = 6  # along each side: the blocks of the jackknife
_APART, _LEAST = 3.0, 0.01  # deviations, and share of the light, of planes that differ
_METHOD = "plane through what two pictures differ by, parts of the field left out"


@dataclass(slots=True, kw_only=True)
class FieldPictures:
    """Sum of pictures of one field, which stay no longer in memory."""

    taken: int = 0
    rounding: float = 0.0  # deviation of light at one place by whole counts, of light
    _total: FloatArray | None = None
    _first: FloatArray | None = None  # (_TILES, _TILES), its mean 1

    @property
    def mean(self) -> FloatArray | None:
        """Return the mean light, (rows, columns) 0..1; None without a picture."""
        return None if self._total is None else self._total / self.taken

    def add(self, light: FloatArray, rounding: float) -> str:
        """Add a picture; return how its light contradicts the first's, "" if not.

        Parameters
        ----------
        light : (rows, columns) float array
            1 at full scale.
        rounding : float
            As `rounding_sigma` tells it, over the light.
        """
        tiles = _tile_means(light)
        self.taken += 1
        self.rounding = max(self.rounding, rounding)
        if self._total is None or self._first is None:
            self._total, self._first = light.copy(), tiles
            return ""
        self._total += light
        return _contradiction(plane_change(tiles - self._first), self.rounding)


def rounding_sigma(counts: FloatArray) -> float:
    """Return the deviation of the mean of many counts of one light by rounding, counts.

    Noise between neighbours makes it small, and larger steps, as of dust, count as one.

    Parameters
    ----------
    counts : (rows, columns) float array
        Whole numbers.

    References
    ----------
    Widrow & Kollar (2008), Quantization Noise: the mean error of rounded normal values
    falls as exp(-2 pi^2 sigma^2); here times the deviation of one that is uniform.
    """
    steps = np.minimum(np.abs(np.diff(counts, axis=1)), 1.0)
    noise = max(float(np.mean(steps**2)) / 2 - 1 / 12, 0.0)
    return math.exp(-2 * math.pi**2 * noise) / math.sqrt(12)


def plane_change(tiles: FloatArray) -> VectorEstimate:
    """Return change of light over the width, to the right, and the height, up, (2,).

    What is curved is fitted beside it, and adds nothing to the deviations.

    Parameters
    ----------
    tiles : (rows, columns) float array
        Of parts of the field, light over its mean, or a difference of that [1].
    """
    rows, columns = tiles.shape
    right = (np.arange(columns) + 0.5) / columns - 0.5
    up = 0.5 - (np.arange(rows) + 0.5) / rows
    x, y = (each.ravel() for each in np.meshgrid(right, up))
    blocks = np.column_stack(
        [np.ones(x.size), x, y, x * x, x * y, y * y, tiles.ravel()]
    )
    return jackknife_vector(_plane, list(blocks), method=_METHOD)


def _plane(blocks: Sequence[FloatArray]) -> FloatArray:
    """Return what goes with the second and third number of blocks of seven, (2,)."""
    rows = np.array(blocks)
    return np.asarray(np.linalg.lstsq(rows[:, :6], rows[:, 6], rcond=None)[0][1:3])


def _tile_means(light: FloatArray) -> FloatArray:
    """Return the means of parts (_TILES, _TILES) of light, over the mean of all.

    0 of a picture without light, which `field_light` refuses.
    """
    rows, columns = (
        np.linspace(0, size, _TILES, endpoint=False).astype(np.intp)
        for size in light.shape
    )
    sums = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    lines = (
        np.diff([*at, n]) for at, n in zip((rows, columns), light.shape, strict=True)
    )
    means = sums / np.outer(*lines)
    level = float(means.mean())
    return np.asarray(means / level) if level > 0 else np.zeros_like(means)


def _contradiction(change: VectorEstimate, rounding: float) -> str:
    """Return by how much two planes differ, in words, "" if by chance or little."""
    for k, way in enumerate(("width", "height")):
        one = change.one(k)
        sigma = math.hypot(one.sigma or 0.0, 2 * rounding)  # two borders, two pictures
        if abs(one.value) > max(_APART * sigma, _LEAST):
            off = f"{one.value:+.3f} +- {sigma:.2g}"
            return f"its gradient differs by {off} over the {way}"
    return ""
