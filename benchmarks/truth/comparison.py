"""Comparison of a look's two pictures over all pixels of its region."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.truth.compiler_side import trial_image
from benchmarks.truth.judged_looks import JudgedLook, cell_image
from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import RaySampling

CLOSE = 0.01  # of full scale
LEAST_SHARE, MOST_ERROR, MOST_RMS = 0.995, 0.02, 0.003  # aims at equal optics
# finer than a run's pictures: edges in focus that walls mirror to a step of the grid
JUDGE = RaySampling(
    rays=720, spacing=0.06, least_spacing_um=0.6, most_spacing_um=2.5,
    plane_spacing_um=1.6, edge_um=0.2, tolerance=0.002,
)  # fmt: skip
# another pattern of rays through pupil and lamp, from other points
TURNED = replace(
    JUDGE, turn_rad=1.0, spacing=0.051, plane_spacing_um=1.36, edge_um=0.17
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureError:
    """How far two pictures of one region are apart, shares of full scale."""

    max_error: float
    rms: float
    share: float  # of pixels that are within `CLOSE`

    @property
    def passes(self) -> bool:
        """Return whether the pictures meet the aims."""
        near = self.share >= LEAST_SHARE and self.max_error <= MOST_ERROR
        return near and self.rms <= MOST_RMS


@dataclass(frozen=True, slots=True, kw_only=True)
class LookComparison:
    """A look's pictures on both roads."""

    id: str
    error: PictureError
    sampling: PictureError  # of the cell's road: two patterns of rays


def apart(one: FloatArray, other: FloatArray) -> PictureError:
    """Return how far two pictures are apart."""
    away = np.abs(one - other)
    return PictureError(
        max_error=float(away.max()),
        rms=float(np.sqrt(np.mean(away**2))),
        share=float(np.mean(away <= CLOSE)),
    )


def compared(look: JudgedLook) -> LookComparison:
    """Return a look's errors at equal optics, and the cell's own."""
    found = cell_image(look.cell, JUDGE)
    return LookComparison(
        id=look.id,
        error=apart(trial_image(look.trial.case), found),
        sampling=apart(cell_image(look.cell, TURNED), found),
    )


def worst(errors: Sequence[PictureError]) -> PictureError:
    """Return the worst of each number."""
    return PictureError(
        max_error=max(e.max_error for e in errors),
        rms=max(e.rms for e in errors),
        share=min(e.share for e in errors),
    )
