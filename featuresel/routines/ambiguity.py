"""Whether an image shows at which of a pattern's equal turns the target is."""

from __future__ import annotations

import math

import numpy as np

from featuresel.routines import FloatArray
from featuresel.routines.appearance import Pose
from featuresel.routines.comparison import Job, misfits

_UNEXPLAINED = 1.5  # chi squared a pixel: of 300 pixels noise makes 1.4 in 5 deviations
_SHARE = 0.5  # of what the next turn leaves unexplained, that the one found may


def is_ambiguous(job: Job, found: Pose, turns: FloatArray) -> bool:
    """Return whether what breaks a pattern's symmetry is missing at the turn found.

    Parameters
    ----------
    job : Job
        The images.
    found : Pose
        What fits best.
    turns : (T,) float array
        The other turns that the target may have, rad.

    Notes
    -----
    A notch that is hidden is missed alike at all turns. At the turn found the image
    then leaves nearly as much unexplained as at the next one, or more.
    """
    if len(turns) == 0:
        return False
    here = float(misfits(job, found, np.array([found.turn_rad]))[0])
    other = float(misfits(job, found, turns).min())
    return here > _UNEXPLAINED and here - 1 > _SHARE * (other - 1)


def other_turns(turn_rad: float, symmetry: float, range_rad: float) -> FloatArray:
    """Return the equal turns of a pattern besides one, that are within a range."""
    turns = turn_rad + 2 * math.pi / symmetry * np.arange(1, int(symmetry))
    turns = np.remainder(turns + math.pi, 2 * math.pi) - math.pi
    within: FloatArray = turns[np.abs(turns) <= range_rad]
    return within
