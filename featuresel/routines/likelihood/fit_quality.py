"""How well most pixels fit a model, whatever the rest of them are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.likelihood.comparison import REJECT
from microplan.featuresel.routines.sampling import median

_TO_SIGMA = 1.4826  # of a normal distribution, over its median distance from 0
# Tukey's cut that costs 5 % where all is normal, in standard deviations, and the mean
# square of normal numbers by those weights
_CUT, _SQUARE = 4.685, 0.82807


@dataclass(frozen=True, slots=True)
class FitQuality:
    """Residuals in standard deviations, those that most of them have."""

    chi2: float  # their mean square: 1 where noise and discrepancy explain them
    used: float  # share of all that pixels tell of the place, told by these
    left: float  # mean square of all, far ones cut: what fits of one image differ in

    @property
    def score(self) -> float:
        """Return the share of edges that fits, less where they fit worse than noise."""
        return self.used / max(1.0, self.chi2)


def usual_size(residual: FloatArray) -> float:
    """Return the standard deviation of most residuals, (N,), at least 1."""
    return max(1.0, _TO_SIGMA * median(np.abs(residual)))


def quality(residual: FloatArray, clear: BoolArray, slopes: FloatArray) -> FitQuality:
    """Return how well pixels fit.

    Parameters
    ----------
    residual : (N,) float array
        Differences over their expected standard deviations.
    clear : (N,) bool array
        Pixels that are neither cut off nor saturated: the others tell nothing.
    slopes : (2, N) float array
        What residuals change by with the place, per pixel: their squares are what each
        tells of it.

    Notes
    -----
    By Tukey's weights about the usual size of residuals: dust on an edge, or another
    thing beside the target, takes its pixels from `used` and leaves `chi2`. So does an
    edge that another part has elsewhere, and of a target's pixels edges are few: each
    counts by what it tells. A mark that tells turns apart is as small as dust: `left`
    has it.

    References
    ----------
    Beaton & Tukey (1974).
    """
    if not clear.any():
        return FitQuality(chi2=np.inf, used=0.0, left=np.inf)
    told, tells = residual[clear], (slopes[:, clear] ** 2).sum(axis=0)
    ratio = told / (_CUT * usual_size(told))
    weight = np.where(np.abs(ratio) < 1, (1 - ratio**2) ** 2, 0.0)
    chi2 = float(weight @ told**2 / weight.sum() / _SQUARE)
    return FitQuality(
        chi2=chi2,
        used=float(tells[weight > 0].sum() / max(tells.sum(), 1e-300)),
        left=float(np.minimum(told**2, REJECT**2).mean()),
    )
