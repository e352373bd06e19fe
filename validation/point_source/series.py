"""The pictures, and what their file's name says of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import tifffile

Floats = npt.NDArray[np.float64]

STEP_UM = 0.3  # from plane to plane
APERTURE, WAVELENGTH_UM, INDEX = 0.85, 0.52, 1.0
UM_PER_PX = 0.13
CORNER = 8  # px: squares in the corners show no light where the lens is near focus
NEAREST = 12  # the plane with the highest peak


def read_series() -> Floats:
    """Return counts less the dark ones, (planes, rows, columns), a plane `STEP_UM` on.

    Each plane is as bright as its own light.
    """
    found = tifffile.imread(Path(__file__).with_name("series.tif")).astype(np.float64)
    return found - float(np.median(_corners(found)))


def noise_counts(series: Floats) -> float:
    """Return the standard deviation of the counts where it is dark."""
    return float(_corners(series).std())


def _corners(series: Floats) -> Floats:
    """Return what the corners hold of the plane nearest to focus."""
    rows = np.concatenate([series[NEAREST, :CORNER], series[NEAREST, -CORNER:]])
    return np.concatenate([rows[:, :CORNER], rows[:, -CORNER:]])
