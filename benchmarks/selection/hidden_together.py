"""What layers out of focus hide together, less what the product of their blurs says.

A ray that one layer stops, meets no other below it: shares that two blurred layers
hide do not multiply. Sharp masks of shapely's polygons, moved as each ray of the pupil
moves them, tell by how much.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.light.sharp_rays import sharp_polygon

_RAYS = 1024


def hidden_together(
    case: LookCase, layers: Sequence[Layer], scope: Microscope, window: Window
) -> FloatArray:
    """Return by how much layers laid ray by ray are brighter than by their blurs.

    Parameters
    ----------
    case : LookCase
        Background and focus.
    layers : sequence of Layer
        As they lie, from below.
    scope, window
        Pixels wanted, small against any blur that matters.

    Returns
    -------
    (rows, columns) array
        Shares of full scale in even light: smooth where both layers are blurred, 0
        where one is not. What meets in focus is cut off before it diffracts.
    """
    shape = window.rows, window.columns
    moves = [_moves_px(layer.z_um - case.focus_um, scope) for layer in layers]
    masks = [
        _mask(layer, scope, window, int(np.abs(by).max(initial=0)))
        for layer, by in zip(layers, moves, strict=True)
    ]
    together = np.zeros(shape)
    shares = np.zeros((len(layers), *shape))
    for ray in range(_RAYS):
        hit = [
            _moved(mask, by[ray], shape) for mask, by in zip(masks, moves, strict=True)
        ]
        together += _laid(case.background, layers, hit) / _RAYS
        shares += np.array(hit) / _RAYS
    return _seen(together - _laid(case.background, layers, shares), scope)


def _seen(image: FloatArray, scope: Microscope) -> FloatArray:
    """Return what the lens resolves of an image in focus: its optical transfer."""
    frequency = np.hypot(*np.meshgrid(*map(np.fft.fftfreq, image.shape), indexing="ij"))
    cutoff = 2 * scope.aperture / scope.wavelength_um * scope.um_per_px
    s = np.minimum(frequency / cutoff, 1)
    transfer = 2 / math.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    return np.asarray(np.fft.ifft2(np.fft.fft2(image) * transfer).real)


def _laid(
    background: float,
    layers: Sequence[Layer],
    shares: Iterable[FloatArray | BoolArray],
) -> FloatArray:
    """Return layers over each other from below, each hiding its share."""
    image: FloatArray = np.array(background)
    for layer, share in zip(layers, shares, strict=True):
        image = image + share * (layer.reflectance - image)
    return image


def _moves_px(z_um: float, scope: Microscope) -> FloatArray:
    """Return (rays, 2) rows and columns that rays move a layer's mask by.

    A sunflower of the pupil: even in sines.
    """
    k = np.arange(_RAYS)
    sine = scope.aperture / scope.medium_index * np.sqrt((k + 0.5) / _RAYS)
    off_px = z_um * sine / np.sqrt(1 - sine**2) * scope.px_per_um
    turn = k * math.pi * (3 - math.sqrt(5))
    found: FloatArray = np.rint(
        np.column_stack([off_px * np.cos(turn), off_px * np.sin(turn)])
    )
    return found


def _mask(layer: Layer, scope: Microscope, window: Window, more: int) -> BoolArray:
    """Return what of a window, wider by some pixels all round, a layer covers."""
    rows = window.row - more + np.arange(window.rows + 2 * more)
    columns = window.column - more + np.arange(window.columns + 2 * more)
    x_um = (columns + 0.5 - scope.width_px / 2) * scope.um_per_px
    y_um = (scope.height_px / 2 - rows - 0.5) * scope.um_per_px
    points = np.meshgrid(x_um, y_um)
    return np.asarray(shapely.contains_xy(sharp_polygon(layer.outline), *points))


def _moved(mask: BoolArray, by: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """Return a mask moved, of the window's shape."""
    row, column = ((size - n) // 2 for size, n in zip(mask.shape, shape, strict=True))
    row, column = row + int(by[0]), column + int(by[1])
    return mask[row : row + shape[0], column : column + shape[1]]
