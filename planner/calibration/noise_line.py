"""Noise as a straight line over the level, as photons and read noise have it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from microplan.arrays import FloatArray
from microplan.optics.lens.sensor import ROUNDING
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    jackknife_vector,
)
from microplan.planner.calibration.photon_transfer import CHART, FLAT, NoiseRow

_FEWEST_ROWS = 5  # of which a line, two numbers, leaves three to judge it
_DOUBT = 0.001  # chance at which a line that is right is taken for a wrong one
_ROUNDS = 8  # of weights by the line's own variance: they settle in three


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseLine:
    """Variance over level as a straight line, as photons and read noise have it."""

    gain: BlockEstimate  # counts squared a count: counts an electron
    at_zero: BlockEstimate  # variance at level 0, counts squared, rounding included
    chance: float  # of departures this large if the line is right
    departure: float  # rms of rows' departures over their variance

    @property
    def suffices(self) -> bool:
        """Return whether photons and read noise explain the rows; else take a table."""
        return self.gain.value > 0 and self.chance > _DOUBT

    def full_well_e(self, black: float, white: float) -> BlockEstimate:
        """Return the electrons between the counts of darkness and of saturation.

        ValueError if the line falls, or `white` is not above `black`.
        """
        if not (self.gain.value > 0 and white > black):
            raise ValueError("the line must rise, and white be above black")
        value = (white - black) / self.gain.value
        share = None
        if self.gain.sigma is not None:
            share = self.gain.sigma / self.gain.value
        return BlockEstimate(
            value=value,
            sigma=None if share is None else value * share,
            method=self.gain.method,
            blocks=self.gain.blocks,
        )

    def read_noise_e(self, black: float) -> float:
        """Return one standard deviation in darkness, rounding taken off, in electrons.

        0 where the line is below rounding there. ValueError if the line falls.
        """
        if not self.gain.value > 0:
            raise ValueError("the line must rise")
        dark = self.at_zero.value + self.gain.value * black - ROUNDING
        return math.sqrt(max(dark, 0.0)) / self.gain.value


def noise_line(rows: Sequence[NoiseRow]) -> NoiseLine | Refused:
    """Return the line of variance over level, and whether it suffices.

    Each row weighs by the variance that the line gives it; the deviations of rows,
    poorly known one by one, are pooled as one share of the variance a pixel. The test
    grants each row what vibration may have added besides.

    Parameters
    ----------
    rows : sequence of NoiseRow
        As `noise_rows` returns them.
    """
    known = [row for row in rows if row.sigma is not None and row.variance > 0]
    if len(known) < _FEWEST_ROWS:
        why = f"{len(known)} levels of known deviation, {_FEWEST_ROWS} are needed"
        return Refused(what="line of noise over level", why=why, take=CHART)
    level = np.array([row.level for row in known])
    variance = np.array([row.variance for row in known])
    spread = np.array([row.sigma for row in known], dtype=np.float64) / variance
    pixels = np.array([row.pixels for row in known], dtype=np.float64)
    share = math.sqrt(float(np.mean(spread**2 * pixels))) / np.sqrt(pixels)
    triples = np.stack([level, variance, share], axis=1)
    line = jackknife_vector(
        lambda some: _line(np.array(some)),
        list(triples),
        method="weighted line through variances of levels, levels left out in turn",
    )
    meant = line.values[0] + line.values[1] * level
    off = (variance - meant) / np.maximum(meant, variance.min() / 2)
    square = float(np.sum(off**2 / (share**2 + FLAT**2)))
    return NoiseLine(
        gain=line.one(1),
        at_zero=line.one(0),
        chance=float(chi2.sf(square, len(known) - 2)),
        departure=math.sqrt(float(np.mean(off**2))),
    )


def _line(rows: FloatArray) -> FloatArray:
    """Return the line, (2,), of rows (N, 3): level, variance, its error's share."""
    level, variance, share = rows.T
    design = np.stack([np.ones_like(level), level], axis=1)
    line, found = np.zeros(2), variance
    for _ in range(_ROUNDS):
        sigma = np.maximum(share * found, 1e-9)
        line = np.linalg.lstsq(design / sigma[:, None], variance / sigma, rcond=None)[0]
        found = np.maximum(design @ line, variance.min() / 2)
    return np.asarray(line)
