"""Noise of a camera by its level, from frames of a still scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.optics.lens.sensor import ROUNDING
from microplan.planner.calibration.count_levels import CountLevels
from microplan.planner.calibration.estimates import jackknife_sigma
from microplan.planner.calibration.still_frames import StillScene

MOST_ROWS = 24
_CLEAR = 5.0  # standard deviations from where counts are cut off
FLAT = 0.02  # of a pixel's variance that vibration may add, or it is left out
_TILES = 8  # a side, blocks of the jackknife
_FEWEST = 200  # values of a row: its variance is known to 10 %
_APART = 1.0  # counts between rows
CHART = "a chart or a field with even patches between dark and bright"


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseRow:
    """Noise in time at one level."""

    level: float  # counts
    variance: float  # counts squared, rounding included
    sigma: float | None  # standard deviation of the variance; None: too few blocks
    pixels: int


def noise_rows(scene: StillScene, levels: CountLevels) -> tuple[NoiseRow, ...]:
    """Return the noise by level, rising; empty if too few pixels tell it.

    Pixels are left out that are cut off in any frame or nearly, since what is cut off
    has no noise, and pixels at edges, where vibration looks like noise.

    Parameters
    ----------
    scene : StillScene
        Of two frames or more.
    levels : CountLevels
        Of the same frames.

    Returns
    -------
    tuple of NoiseRow
        At most `MOST_ROWS`, with about as many pixels each.
    """
    mean, variance = scene.mean, scene.variance
    clear = _clear(scene, levels)
    flat = _is_flat(scene, clear)
    tiles = _tiles(mean.shape)
    rows = [
        _row(mean, variance, tiles, chosen) for chosen in _by_level(mean, flat, scene)
    ]
    return tuple(rows)


def pooled_rows(
    scenes: Iterable[StillScene], levels: CountLevels
) -> tuple[NoiseRow, ...]:
    """Return the noise by level of several still scenes of one camera, rising.

    Parameters
    ----------
    scenes : iterable of StillScene
        Of two frames or more each.
    levels : CountLevels
        Of all frames.
    """
    found = [row for scene in scenes for row in noise_rows(scene, levels)]
    found.sort(key=lambda row: row.level)
    total, upto = sum(row.pixels for row in found), 0
    bins: dict[int, list[NoiseRow]] = {}
    for row in found:
        bins.setdefault(upto * MOST_ROWS // total, []).append(row)
        upto += row.pixels
    return tuple(_pooled(rows) for rows in bins.values())


def _pooled(rows: Sequence[NoiseRow]) -> NoiseRow:
    """Return rows of about one level as one; they err independently."""
    pixels = np.array([row.pixels for row in rows], dtype=np.float64)
    share = pixels / pixels.sum()
    sigmas = [row.sigma for row in rows if row.sigma is not None]
    sigma = None
    if len(sigmas) == len(rows):
        sigma = float(np.sqrt(np.sum((share * sigmas) ** 2)))
    return NoiseRow(
        level=float(share @ [row.level for row in rows]),
        variance=float(share @ [row.variance for row in rows]),
        sigma=sigma,
        pixels=int(pixels.sum()),
    )


def _clear(scene: StillScene, levels: CountLevels) -> BoolArray:
    """Return which pixels are far from where counts are cut off, (rows, columns).

    By the noise of their level, too: those that chance spared would show too little.
    """
    white = np.inf if levels.white_level is None else levels.white_level
    spared = np.asarray((scene.lowest > 0) & (scene.highest < white))
    if not spared.any():
        return spared
    off = _CLEAR * np.sqrt(_usual(scene.mean, scene.variance, spared))
    return np.asarray(spared & (scene.mean > off) & (scene.mean < white - off))


def _is_flat(scene: StillScene, clear: BoolArray) -> BoolArray:
    """Return where vibration adds little to the noise, (rows, columns).

    What it adds is the squared slope times its own variance, of each axis, which are
    fitted to what variances exceed the usual one of their level by.
    """
    variance, (down, across) = scene.variance, scene.slopes**2
    if min(variance.shape) < 2 or not clear.any():
        return clear
    usual = np.maximum(_usual(scene.mean, variance, clear), ROUNDING)
    slopes = np.stack([down[clear], across[clear]], axis=1) / usual[clear][:, None]
    excess = (variance / usual - 1)[clear]
    shaken = np.asarray(nnls(slopes.T @ slopes, slopes.T @ excess)[0])
    added = shaken[0] * down + shaken[1] * across
    return np.asarray(clear & (added <= FLAT * usual))


def _usual(mean: FloatArray, variance: FloatArray, clear: BoolArray) -> FloatArray:
    """Return the median variance of pixels about as bright, (rows, columns)."""
    ranks = np.quantile(mean[clear], np.linspace(0, 1, MOST_ROWS + 1)[1:-1])
    which = np.searchsorted(ranks, mean)
    found = np.zeros(MOST_ROWS)
    for row in range(MOST_ROWS):
        own = variance[clear & (which == row)]
        found[row] = np.median(own) if own.size else 0.0
    usual: FloatArray = found[which]
    return usual


def _tiles(shape: tuple[int, ...]) -> IntArray:
    """Return the tile of each pixel, (rows, columns), from 0."""
    down, across = (np.arange(size) * _TILES // size for size in shape)
    return np.asarray(down[:, None] * _TILES + across)


def _by_level(
    mean: FloatArray, flat: BoolArray, scene: StillScene
) -> Iterator[IntArray]:
    """Yield the pixels of each row, flat indices, the darkest first."""
    pixels = np.flatnonzero(flat)
    fewest = max(-(-_FEWEST // (scene.frames - 1)), 2)
    count = min(MOST_ROWS, pixels.size // fewest)
    if count == 0:
        return
    order = pixels[np.argsort(mean.ravel()[pixels], kind="stable")]
    held: list[IntArray] = []
    last = -np.inf
    for part in np.array_split(order, count):
        held.append(part)
        level = float(mean.ravel()[np.concatenate(held)].mean())
        if level >= last + _APART:
            yield np.concatenate(held)
            held, last = [], level


def _row(
    mean: FloatArray, variance: FloatArray, tiles: IntArray, chosen: IntArray
) -> NoiseRow:
    """Return the noise of some pixels, flat indices."""
    own, where = variance.ravel()[chosen], tiles.ravel()[chosen]
    sums = np.bincount(where, own, _TILES**2).astype(np.float64)
    counts = np.bincount(where, minlength=_TILES**2).astype(float)
    return NoiseRow(
        level=float(mean.ravel()[chosen].mean()),
        variance=float(own.mean()),
        sigma=jackknife_sigma(sums, counts),
        pixels=int(chosen.size),
    )
