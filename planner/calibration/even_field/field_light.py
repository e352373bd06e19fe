"""Gradient of the light over a field with nothing in it, and what no plane explains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_vector,
)
from microplan.planner.calibration.even_field.field_structure import field_structure

_ACROSS = 48  # cells along the shorter side of a picture: dust fills few of them
_TILES = 6  # along each side: the blocks of the jackknife
_FEWEST = 18  # cells along a side: three a tile
_DARK = 0.05  # of full scale: black level and rounding would be seen
_DEGREE = 4  # of the surface that light without structure follows, vignetting too
_SHAPES = 6  # fitted to flat light: level, plane, curves
_ROUNDS, _TRIM = 4, 4.0  # in which cells so many deviations off are left out of it
_ODD, _FAINT = 6.0, 0.01  # deviations, and share of light, of cells with something
_MOST_ODD, _LARGEST = 0.05, 0.02  # of the field; more, or more in one piece: no dust
_ROUGH = 0.02  # of the light from cell to cell: texture, or pictures of much noise
_VAGUE = 0.1  # of the light, from border to border: a standard deviation tells nothing
_NORMAL = 1.4826  # standard deviation over the median of what is off
_METHOD = "plane through the light of an even field, parts of the field left out"
WHAT = "gradient of an even field"
TAKE = (
    "a plane mirror or an empty stage out of focus, wider than the field, at half of "
    "full scale, eight frames or more"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldLight:
    """How light changes over a field."""

    gradient: VectorEstimate  # (2,) change over the width and the height: right, up [1]
    departure: BlockEstimate  # rms of light about its plane, of that in the middle [1]
    dust: float  # share of the field that is left out
    hidden: FloatArray  # (2,) of the gradient's deviations, by a structure unseen [1]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tile:
    """Sums of one part of the field."""

    # (8, 8) of 1, right, up, three of `_curved`, flat light, light, by pairs
    sums: FloatArray
    pairs: int  # of neighbours
    squares: float  # sum of squares by which they differ


def field_light(light: FloatArray, *, rounding: float = 0.0) -> FieldLight | Refused:
    """Return how light changes over a field, or why a picture does not tell it.

    Specks of dust are left out with the cells around them.

    Parameters
    ----------
    light : (rows, columns) float array
        Mean of all pictures, 1 at full scale, in proportion to the light.
    rounding : float
        Deviation of the light at one place by whole counts, over the light.
    """
    side = max(min(light.shape) // _ACROSS, 1)
    cells = _cells(light, side)
    if min(cells.shape) < _FEWEST:
        rows, columns = light.shape
        return _refused(f"pictures of {columns} x {rows} px are too small")
    level = float(np.median(cells))
    if level < _DARK:
        return _refused(
            f"its light is {level:.2%} of full scale, less than {_DARK:.0%}"
        )
    right, up = _places(light.shape, cells.shape, side)
    off, sigma = _off_surface(cells / level, right, up)
    odd = _odd(off, sigma)
    why = _structure(off, odd, sigma)
    if why:
        return _refused(why)
    clean = ~ndimage.binary_dilation(odd, np.ones((3, 3), dtype=np.bool_))
    some = min(light.shape) / 2
    places = right * light.shape[1] / some, up * light.shape[0] / some
    shown = field_structure(cells / level, places, clean, math.hypot(sigma, rounding))
    if shown.words:
        return _refused(shown.words)
    flat = _flattened(cells / level, off, right, up)
    blocks = _tiles(np.stack([right, up, flat, cells / level, off], axis=-1), clean)
    found = jackknife_vector(_plane, blocks, method=_METHOD)
    if found.covariance is None or np.trace(found.covariance[:2, :2]) > 2 * _VAGUE**2:
        return _refused("parts of the field contradict each other")
    return FieldLight(
        gradient=_gradient(found, rounding, shown.hidden),
        departure=_root(found.one(2), rounding),
        dust=1 - float(clean.mean()),
        hidden=shown.hidden,
    )


def _refused(why: str) -> Refused:
    return Refused(what=WHAT, why=why, take=TAKE)


def _cells(light: FloatArray, side: int) -> FloatArray:
    """Return means of squares of so many pixels a side, what is over cut off."""
    rows, columns = (size // side for size in light.shape)
    whole = light[: rows * side, : columns * side]
    found: FloatArray = whole.reshape(rows, side, columns, side).mean(axis=(1, 3))
    return found


def _places(
    size: tuple[int, ...], cells: tuple[int, ...], side: int
) -> tuple[FloatArray, FloatArray]:
    """Return cells' places right and up of the middle, shares of width and height."""
    row, column = np.indices(cells, dtype=np.float64)
    rows, columns = size
    return (column + 0.5) * side / columns - 0.5, 0.5 - (row + 0.5) * side / rows


def _off_surface(
    cells: FloatArray, right: FloatArray, up: FloatArray
) -> tuple[FloatArray, float]:
    """Return what is off a smooth surface, (rows, columns), and a cell's deviation.

    The deviation is that between neighbours: what is smooth adds nothing to it.
    """
    powers = [(a, b) for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]
    design = np.stack([(right**a * up**b).ravel() for a, b in powers], axis=1)
    values, use = cells.ravel(), np.ones(cells.size, dtype=np.bool_)
    off = values
    for _ in range(_ROUNDS):
        off = values - design @ np.linalg.lstsq(design[use], values[use], rcond=None)[0]
        use = np.abs(off) <= max(_TRIM * _NORMAL * float(np.median(np.abs(off))), 1e-9)
    found = off.reshape(cells.shape)
    steps = np.concatenate([np.diff(found, axis=k).ravel() for k in (0, 1)])
    return found, _NORMAL * float(np.median(np.abs(steps))) / math.sqrt(2)


def _flattened(
    cells: FloatArray, off: FloatArray, right: FloatArray, up: FloatArray
) -> FloatArray:
    """Return light (rows, columns) less what of its smooth surface is no plane."""
    smooth = (cells - off).ravel()
    design = np.stack([np.ones(smooth.size), right.ravel(), up.ravel()], axis=1)
    plane = design @ np.linalg.lstsq(design, smooth, rcond=None)[0]
    return np.asarray(plane.reshape(off.shape) + off)


def _odd(off: FloatArray, sigma: float) -> BoolArray:
    """Return the cells (rows, columns) that show something, alone or by threes."""
    alone = np.abs(off) > max(_ODD * sigma, _FAINT)
    mean = np.asarray(ndimage.uniform_filter(off, 3))
    together: BoolArray = np.abs(mean) > max(_ODD * sigma / 3, _FAINT)
    return alone | together


def _structure(off: FloatArray, odd: BoolArray, sigma: float) -> str:
    """Return why a field is not even, "" if it is but for dust."""
    if sigma > _ROUGH:
        return f"its light differs by {sigma:.1%} between neighbouring areas"
    labels, count = ndimage.label(odd, np.ones((3, 3)))
    largest = np.bincount(labels.ravel(), minlength=2)[1:].max() if count else 0
    if odd.mean() <= _MOST_ODD and largest <= _LARGEST * odd.size:
        return ""
    share, most = float(odd.mean()), float(np.abs(off).max())
    words = f"{share:.1%} of the field departs from smooth light, by up to {most:.0%}"
    return f"{words}: it shows something"


def _tiles(columns: FloatArray, clean: BoolArray) -> list[_Tile]:
    """Return the sums of each part of the field.

    Parameters
    ----------
    columns : (rows, columns, 5) float array
        Cells' places right and up, flat light, light, what is off the smooth surface.
    clean : (rows, columns) bool array
        Cells to use.
    """
    found = []
    for rows in np.array_split(np.arange(clean.shape[0]), _TILES):
        for across in np.array_split(np.arange(clean.shape[1]), _TILES):
            tile = np.ix_(rows, across)
            if clean[tile].any():
                found.append(_tile(columns[tile], clean[tile]))
    return found


def _tile(columns: FloatArray, clean: BoolArray) -> _Tile:
    """Return the sums of one part, as `_tiles` has its cells."""
    right, up, *lights = columns[clean][:, :4].T
    shapes = [np.ones(len(right)), right, up, *_curved(right, up)]
    rows = np.column_stack([*shapes, *lights])
    off, pairs, squares = columns[..., 4], 0, 0.0
    for axis in (0, 1):
        both = np.minimum(
            *(np.take(clean, k, axis) for k in _neighbours(clean.shape[axis]))
        )
        pairs += int(both.sum())
        squares += float(np.sum(np.diff(off, axis=axis)[both] ** 2))
    return _Tile(sums=rows.T @ rows, pairs=pairs, squares=squares)


def _curved(right: FloatArray, up: FloatArray) -> tuple[FloatArray, ...]:
    """Return three shapes (N,) of curved light, of mean 0 over the field."""
    return right**2 - 1 / 12, right * up, up**2 - 1 / 12


def _neighbours(count: int) -> tuple[IntArray, IntArray]:
    """Return the numbers of all lines but the last, and of those after them."""
    return np.arange(count - 1), np.arange(1, count)


def _plane(tiles: Sequence[_Tile]) -> FloatArray:
    """Return change to the right, up, and the square of what is left, (3,) [1].

    The change is that of flat light; curves are fitted beside it, for what chance has
    of them is taken off with the surface. What is left is of light itself, without the
    noise of cells: half of the square by which neighbours differ.
    """
    sums = np.sum([tile.sums for tile in tiles], axis=0)
    some = slice(_SHAPES)
    level, x, y = np.linalg.solve(sums[some, some], sums[some, 6])[:3]
    plane = np.linalg.solve(sums[:3, :3], sums[:3, 7])
    left = sums[7, 7] - plane @ sums[:3, 7]
    pairs = max(sum(tile.pairs for tile in tiles), 1)
    noise = sum(tile.squares for tile in tiles) / pairs / 2
    square = left / (sums[0, 0] - 3) - noise
    return np.array([x / level, y / level, square / level**2])


def _gradient(
    found: VectorEstimate, rounding: float, hidden: FloatArray
) -> VectorEstimate:
    """Return the change of light, (2,), of an estimate that begins with it.

    The surface has more numbers than the `_SHAPES` that the jackknife knows of, and has
    taken their chance away: variances grow by the ratio of what is free. That of a
    structure `hidden` in noise is added.
    """
    surface = (_DEGREE + 1) * (_DEGREE + 2) // 2
    free = (found.blocks - _SHAPES) / max(found.blocks - surface, 1)
    chance = np.zeros((2, 2)) if found.covariance is None else found.covariance[:2, :2]
    return VectorEstimate(
        values=found.values[:2],
        covariance=chance * free + np.diag(2 * rounding**2 + hidden**2),
        method=found.method,
        blocks=found.blocks,
    )


def _root(square: BlockEstimate, rounding: float) -> BlockEstimate:
    """Return the root of an estimate that chance may bring below 0."""
    sigma, root = square.sigma or 0.0, math.sqrt(max(square.value, 0.0))
    chance = math.sqrt(sigma)
    known = min(sigma / (2 * root), chance) if root > 0 else chance
    return BlockEstimate(
        value=root,
        sigma=math.hypot(known, rounding),
        method=square.method,
        blocks=square.blocks,
    )
