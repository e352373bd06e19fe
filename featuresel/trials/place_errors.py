"""Statistics of measured places: by axes, or along the one direction known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.trials.bounds import Estimate, estimate
from microplan.featuresel.trials.calibration import SigmaCalibration, calibrate
from microplan.featuresel.trials.outcomes import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceErrors:
    """Errors of the place in the target's frame; None where they are too few."""

    x: Estimate | None = None
    y: Estimate | None = None
    along: Estimate | None = None
    axis_rad: float | None = None
    spread_x: SigmaCalibration | None = None
    spread_y: SigmaCalibration | None = None

    @classmethod
    def of(cls, right: Sequence[Outcome], confidence: float) -> PlaceErrors:
        """Return the statistics of the successes."""
        errors = np.array([o.target_um for o in right if o.target_um is not None])
        spreads = given([o.spread_um for o in right])
        errors = errors.reshape(-1, 2)
        axis = _direction(given([o.axis_rad for o in right]))
        if axis is not None:
            lengths = errors @ np.array([math.cos(axis), math.sin(axis)])
            return cls(
                along=estimate(lengths, confidence),
                axis_rad=axis,
                spread_x=calibrate(lengths, spreads),
            )
        return cls(
            x=estimate(errors[:, 0], confidence),
            y=estimate(errors[:, 1], confidence),
            spread_x=calibrate(errors[:, 0], spreads),
            spread_y=calibrate(errors[:, 1], spreads),
        )

    @property
    def bias_um(self) -> tuple[float, float] | None:
        """Return the mean error in the target's frame."""
        if self.along is not None and self.axis_rad is not None:
            c, s = math.cos(self.axis_rad), math.sin(self.axis_rad)
            return (self.along.mean * c, self.along.mean * s)
        return (self.x.mean, self.y.mean) if self.x and self.y else None

    @property
    def sigma_um(self) -> float | None:
        """Return the spread of the worse axis."""
        sigmas = [a.sigma for a in (self.x, self.y, self.along) if a is not None]
        return max(sigmas, default=None)


def _direction(axes_rad: FloatArray) -> float | None:
    """Return the mean of directions that are the same half a turn on; None of none."""
    if not len(axes_rad):
        return None
    return float(np.angle(np.exp(2j * axes_rad).mean())) / 2


def given(values: Sequence[float | None]) -> FloatArray:
    """Return the values that are there."""
    return np.array([v for v in values if v is not None], dtype=np.float64)
