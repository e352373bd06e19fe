"""Which cells of a template tell the target's pose, and which the light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from featuresel.routines import Camera, FloatArray

BoolArray = npt.NDArray[np.bool_]

SHARE = 0.98  # of the information about each number, that is kept
_PATCH_PX = 12.0  # between patches that tell the light: 2 % of all pixels
_PATCH_RADIUS_PX = 1.0


def informative_cells(
    stack: FloatArray, camera: Camera, *, over: int, gradient: tuple[FloatArray, ...]
) -> BoolArray:
    """Return at each height the fewest cells that hold `SHARE` of the information.

    Small patches all over the template, which tell the light, come with them.

    Parameters
    ----------
    stack : (K, rows, columns) float array
        The light that pixels collect at K focus heights.
    camera : Camera
        Its noise is what the information is measured by.
    over : int
        Samples per pixel.
    gradient : tuple of (K, rows, columns) arrays
        What the light changes by with each number wanted.

    Returns
    -------
    (K, rows, columns) bool array
        Cells that are worth comparing at each height.
    """
    weight = 1 / camera.variance(stack)
    used = np.repeat(_patches(stack.shape[1:], over)[None], len(stack), axis=0)
    for slope in gradient:
        for k, density in enumerate(slope**2 * weight):
            used[k] |= _fewest(density)
    return used


def _fewest(density: FloatArray) -> BoolArray:
    """Return the fewest cells that hold `SHARE` of the sum; none where it is 0."""
    ordered = np.sort(density, axis=None)[::-1]
    total = np.cumsum(ordered)
    if not total[-1] > 0:
        return np.zeros(density.shape, dtype=bool)
    least = ordered[np.searchsorted(total, SHARE * total[-1])]
    return density >= max(float(least), 1e-300)


def _patches(shape: tuple[int, ...], over: int) -> BoolArray:
    """Return small discs all over the template: what is even tells the light."""
    period = _PATCH_PX * over
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float64)
    away = np.hypot(*(np.abs((a + period / 2) % period - period / 2) for a in (u, v)))
    return np.asarray(away <= _PATCH_RADIUS_PX * over)
