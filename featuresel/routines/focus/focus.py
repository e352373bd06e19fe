"""Height by focus: the measure and the fit that a sweep is read with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.focus.measures import MEASURES
from microplan.featuresel.routines.focus.peak import (
    FocusPeak,
    Numbers,
    gaussian_peak,
    mirror_peak,
)

__all__ = ["FITS", "MEASURE", "Fit", "FocusPeak", "peak", "ring_mask", "score"]

Fit = Callable[[Numbers, Numbers], FocusPeak | Failure]
FITS: Mapping[str, Fit] = {"gaussian": gaussian_peak, "mirror": mirror_peak}

# One maximum under noise, most range and least error by fine steps: docs/focus.md has
# the table.
MEASURE = "tenengrad"


def ring_mask(
    shape: tuple[int, int],
    column: float,
    row: float,
    radius_px: float,
    half_px: float,
) -> BoolArray:
    """Return the pixels within `half_px` of a circle, (rows, columns) bool."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    distance = np.hypot(columns - column, rows - row)
    return np.asarray(np.abs(distance - radius_px) <= half_px)


def score(image: FloatArray, mask: BoolArray | None = None) -> float:
    """Return the sharpness of an image by the default measure.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale.
    mask : (rows, columns) bool array, optional
        Pixels that count; default all.

    Raises
    ------
    ValueError
        If no pixel counts or the image is black there.
    """
    return MEASURES[MEASURE](image, mask)


def peak(z_um: Numbers, scores: Numbers, *, noise: float = 0.0) -> FocusPeak | Failure:
    """Return where the scores peak by the default fit, `mirror_peak`.

    Parameters
    ----------
    z_um : (N,) sequence of float
        Stops of the sweep, strictly rising, N >= 5.
    scores : (N,) sequence of float
        Sharpness at each.
    noise : float
        What is known of the standard deviation of a score, over the peak's height.

    Returns
    -------
    FocusPeak or Failure
        Fails with "few_stops", "flat", "border" (the peak is not inside the sweep),
        "several_peaks" or "coarse" (fewer than 4 stops on the peak).

    Raises
    ------
    ValueError
        If the lengths differ, the stops do not rise or a value is not finite.
    """
    return mirror_peak(z_um, scores, noise=noise)
