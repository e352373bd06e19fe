"""Which of a pattern's equal turns an image shows, and whether it shows any."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.featuresel.routines.likelihood.comparison import ImageComparison, at
from microplan.featuresel.routines.likelihood.pose_fit import PoseFit

# A mark that is seen has a share of 1, one that is hidden of 0, each with a deviation
# of 1 / sqrt(told): at three quarters four deviations keep both apart.
_SEEN = 0.75
_TOLD = 256.0
_ENOUGH = 200  # cells: of the gear they tell 5000 and more up to 25 um out of focus


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """How much of what breaks a pattern's symmetry shows at T turns."""

    share: FloatArray  # (T,) 1: all of it, 0: the pattern goes on; -inf: out of view
    told: FloatArray  # (T,) chi squared between the two


def marks(
    job: ImageComparison, found: PoseFit, turns: FloatArray, cells: IntArray
) -> Marks:
    """Return how much of a pattern's mark an image shows at some turns.

    Parameters
    ----------
    job : Job
        The images.
    found : PoseFit
        What fits best, at any of the turns.
    turns : (T,) float array
        Turns from the template, rad.
    cells : (N,) int array
        Of the template: where the mark is.

    Notes
    -----
    A matched filter: what the image has of the difference between the template and
    itself half way round, where the pattern goes on, weighted by the noise.
    """
    cells = cells[:: max(1, len(cells) // _ENOUGH)]
    pose, elsewhere = found.pose, turns + beside(job.symmetry)
    shown, told = np.zeros(len(turns)), np.zeros(len(turns))
    for view in job.views:
        here = at(pose, view)
        seen = job.looks.turned(here, turns, cells, job.shape)
        plain = job.looks.values(here, elsewhere, seen.columns, seen.rows)
        marked, even = (
            job.lit(here, light, seen.columns, seen.rows, found.light)
            for light in (seen.value, plain)
        )
        value = view.image[seen.rows, seen.columns]
        weight = (marked - even) * seen.inside / job.camera.variance(marked)
        shown += (weight * (value - even)).sum(axis=1)
        told += (weight * (marked - even)).sum(axis=1)
    share = np.where(told > 0, shown / np.maximum(told, 1e-12), -math.inf)
    return Marks(share=share, told=told)


def is_marked(found: Marks) -> bool:
    """Return whether the first of `equal_turns`, and none more, shows the mark.

    Half a period off it shows nearly as much of one that is wide.
    """
    whole = found.share[[0, *range(3, len(found.share))]]
    best = bool(whole[0] >= whole.max())
    return best and bool(found.told[0] > _TOLD and whole[0] > _SEEN)


def beside(symmetry: int) -> float:
    """Return the turn by whole periods that leads farthest away, rad."""
    return 2 * math.pi / symmetry * round(symmetry / 2)


def equal_turns(turn_rad: float, symmetry: int) -> FloatArray:
    """Return a turn, those half a period off, and all others of a pattern, rad."""
    steps = np.array([0.0, -0.5, 0.5, *range(1, symmetry)])
    return np.asarray(turn_rad + steps * 2 * math.pi / symmetry)


def other_turns(turn_rad: float, symmetry: float, range_rad: float) -> FloatArray:
    """Return the equal turns of a pattern besides one, that are within a range."""
    turns = turn_rad + 2 * math.pi / symmetry * np.arange(1, int(symmetry))
    turns = np.remainder(turns + math.pi, 2 * math.pi) - math.pi
    within: FloatArray = turns[np.abs(turns) <= range_rad]
    return within
