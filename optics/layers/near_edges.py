"""Where bodies near focus have their edges: at the pixels, and on a lattice."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.optics.layers.coaxial_light import pixel_axes_um
from microplan.optics.layers.lattice import EvenPoints, Lattice
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope

# a coverage this close to 0 or 1, as in `microplan.optics.layers.occlusion`
_UNIFORM = 0.005
_ABOUT_UM = 4.0  # beyond an edge: lens and spline feel no more


def partly_covered(coverages: Sequence[FloatArray]) -> FloatArray | None:
    """Return where layers cover in part, (rows, columns): 1, and less beside it.

    Images must change smoothly as a body moves: slopes are differences of them.
    """
    if not coverages:
        return None
    partly = np.max([np.minimum(c, 1 - c) for c in coverages], axis=0)
    found: FloatArray = np.clip(partly / _UNIFORM - 1, 0.0, 1.0)
    return found


def points_about(
    where: BoolArray,
    lattice: Lattice,
    microscope: Microscope,
    frame: Window,
    shift_um: tuple[float, float],
) -> BoolArray:
    """Return the points of a lattice about some pixels, (rows, columns) each."""
    x, y = pixel_axes_um(microscope, frame, shift_um)
    (left, top), step = lattice.corner_um, lattice.step_um
    down = _nearest((top, -step, lattice.shape[0]), y)
    right = _nearest((left, step, lattice.shape[1]), x)
    wide = 2 * math.ceil(_ABOUT_UM / microscope.um_per_px) + 1
    return np.asarray(maximum_filter(where, wide)[np.ix_(down, right)])


def _nearest(places: EvenPoints, axis: EvenPoints) -> IntArray:
    """Return the nearest pixel of an axis to each place."""
    at_um = places[0] + places[1] * np.arange(places[2])
    first, step, count = axis
    nearest = np.rint((at_um - first) / step)
    found: IntArray = np.clip(nearest, 0, count - 1).astype(np.intp)
    return found
