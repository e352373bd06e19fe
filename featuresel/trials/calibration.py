"""A routine's own standard deviation calibrated by its errors in trials."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray

COVERAGE = 0.95  # of intervals, two-sided


@dataclass(frozen=True, slots=True, kw_only=True)
class SigmaCalibration:
    """What a routine's own standard deviation along one axis is multiplied by.

    `sigma` is one standard deviation; `half` holds `COVERAGE` of the errors, whatever
    the shape of their distribution. Both are of the error less `bias`.
    """

    bias: float
    factor: float  # to the standard deviation
    reach: float  # to half of an interval; inf where trials are too few
    count: int


def calibrate(errors: FloatArray, spreads: FloatArray) -> SigmaCalibration | None:
    """Return the calibration of one axis.

    Parameters
    ----------
    errors : (N,) float array
        Measured - true.
    spreads : (N,) float array
        What the routine itself took for its standard deviation.

    Returns
    -------
    SigmaCalibration or None
        None of fewer than four answers, or where a spread is not positive: nothing
        makes that an honest one.

    Notes
    -----
    The factor squared is the sum of (error - bias)**2 / spread**2 over N - 3: one for
    the bias, two because 1 / chi-square has a mean of 1 / (N - 3), so that the
    normalised squared error of a *later* trial is 1 on average. The reach is the
    ceil((N + 1) COVERAGE)-th smallest |error - bias| / spread, which a later one
    exceeds with probability 1 - COVERAGE at most.

    References
    ----------
    The reach: Vovk, Gammerman & Shafer (2005), Algorithmic Learning in a Random World
    (split conformal prediction; here the bias is of the same trials).
    """
    if len(errors) < 4 or not (spreads > 0).all():
        return None
    bias = float(errors.mean())
    ratios = np.sort(np.abs(errors - bias) / spreads)
    place = math.ceil((len(ratios) + 1) * COVERAGE)
    return SigmaCalibration(
        bias=bias,
        factor=math.sqrt(float((ratios**2).sum()) / (len(ratios) - 3)),
        reach=float(ratios[place - 1]) if place <= len(ratios) else math.inf,
        count=len(ratios),
    )
