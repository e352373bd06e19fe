"""By how much errors of images change the variance of answers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.used_poses import LEAST


@dataclass(frozen=True, slots=True, kw_only=True)
class PosedChange:
    """What a better image changes of an answer at one pose, along K axes."""

    at_um: FloatArray  # (3,), displacement of the target, and of the focus
    error: FloatArray  # (K,), of the usual answer
    change: FloatArray  # (K,), the better one's less that, without the mean of its end


Changes = Mapping[int, PosedChange]  # by the number of a trial


def added_variance(effects: Sequence[Changes]) -> FloatArray | None:
    """Return by how much effects change the variance of answers, (K,) squared units.

    All effects together; negative where better images make answers vary less. None of
    fewer than `LEAST` common poses.

    Parameters
    ----------
    effects : sequence of mapping of int to PosedChange
        Of one chain at the same poses.

    Notes
    -----
    What follows a plane over the displacements and the focus is new, and its variance
    counts. About the plane an answer that hangs on details, as of a threshold, errs
    otherwise on another image, and no more: the variance of a sum is that of both parts
    and twice their covariance, which is negative then. Less than 0 counts only beyond
    its standard error over the poses: noise of the usual images, as of their few rays,
    is in their answers and not in the better ones.
    """
    common = [trial for trial in effects[0] if all(trial in each for each in effects)]
    if len(common) < LEAST:
        return None
    poses = [effects[0][trial] for trial in common]
    change = np.array([sum(each[t].change for each in effects) for t in common])
    error = np.array([pose.error for pose in poses])
    matrix = np.array([[1.0, *pose.at_um] for pose in poses])
    rank = int(np.linalg.matrix_rank(matrix))
    free = len(common) - rank
    left, errs = (value - matrix @ np.linalg.pinv(matrix) @ value
                  for value in (change, error))  # fmt: skip
    about = (left**2).sum(axis=0) / free
    along = np.maximum(change.var(axis=0, ddof=1) - about, 0.0)
    each = left**2 + 2 * left * errs
    more = each.sum(axis=0) / free
    error = each.std(axis=0, ddof=1) * math.sqrt(len(common)) / free
    found: FloatArray = along + np.where(more > 0, more, np.minimum(more + error, 0.0))
    return found
