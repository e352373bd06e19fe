"""Statistics of what better images change of answers: mean, half-width, sigma."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.added_variance import Changes, PosedChange
from microplan.planner.looks.model_errors.used_poses import LEAST

_SHARE = 0.975  # below a two-sided 95 % half-width

Poses = Mapping[int, FloatArray]  # by the number of a trial, an array (K,)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerShift:
    """Difference of two answers along K axes, over poses: arrays (K,).

    Of an interval the mean is the middle of both ends'.
    """

    pairs: int
    freedom: int  # degrees of freedom of the half-width
    mean: FloatArray
    half_width: FloatArray  # two-sided 95 %, with the interval
    interval: FloatArray  # half of the distance between both ends' means
    sigma: FloatArray  # standard deviation at an end, over poses
    changes: tuple[Changes, ...] = ()  # pose by pose, of each end tried at all of them

    @property
    def goes_on(self) -> bool:
        """Return whether it was tried at more poses than the least."""
        return any(trial >= LEAST for each in self.changes for trial in each)


def difference(
    ends: Sequence[Poses],
    at_um: Sequence[Poses],
    errors: Sequence[Poses],
    *,
    is_apart: bool,
) -> AnswerShift:
    """Return the statistics of differences at one end, or at both of an interval.

    Parameters
    ----------
    ends : sequence of mapping of int to (K,) float array
        Differences along K axes by the trial's number, at each end.
    at_um : sequence of mapping of int to (3,) float array
        The displacements of these trials, and of their focus, um; their mean is known
        to be 0.
    errors : sequence of mapping of int to (K,) float array
        Errors of the usual answers in them, along the same axes.
    is_apart : bool
        Whether the ends were tried at poses of their own; else at the same ones.

    Raises
    ------
    ValueError
        If an end has fewer than `LEAST` / 2 poses.

    Notes
    -----
    The mean over poses is the value of a plane through the differences at the
    displacement 0, and its half-width Student's by what the plane leaves: the
    displacement is a control variate (Lavenberg and Welch 1981), so that what changes
    its sign with it has no part. The middle of two ends and half their distance are
    each known so well: both count.
    """
    if any(len(end) < LEAST // 2 for end in ends):
        raise ValueError(f"an end needs {LEAST // 2} poses at least")
    if len(ends) == 2 and not is_apart:
        return _of_both(ends, at_um, errors)
    planes = [plane_of(*each) for each in zip(ends, at_um, strict=True)]
    means = [plane.mean for plane in planes]
    free = max(sum(plane.freedom for plane in planes), 1)
    left = np.sqrt(np.sum([plane.left for plane in planes], axis=0) / free)
    error = left * math.sqrt(sum(p.scale for p in planes)) / len(planes)
    interval: FloatArray = (np.max(means, axis=0) - np.min(means, axis=0)) / 2
    return AnswerShift(
        pairs=sum(len(end) for end in ends),
        freedom=free,
        mean=np.mean(means, axis=0),
        half_width=interval + len(ends) * student(free) * error,
        interval=interval,
        sigma=pooled([list(end.values()) for end in ends]),
        changes=(changes(ends, at_um, errors),),
    )


def _of_both(
    ends: Sequence[Poses], at_um: Sequence[Poses], errors: Sequence[Poses]
) -> AnswerShift:
    """Return the statistics of an interval whose ends were tried at the same poses."""
    low, high = ends
    both = [trial for trial in low if trial in high]
    middle = plane_of({k: (low[k] + high[k]) / 2 for k in both}, at_um[0])
    apart = plane_of({k: (high[k] - low[k]) / 2 for k in both}, at_um[0])
    interval: FloatArray = np.abs(apart.mean)
    free = max(middle.freedom, 1)
    error = sum(np.sqrt(each.left / free * each.scale) for each in (middle, apart))
    return AnswerShift(
        pairs=len(both),
        freedom=free,
        mean=middle.mean,
        half_width=interval + student(free) * error,
        interval=interval,
        sigma=pooled([list(end.values()) for end in ends]),
        changes=tuple(
            changes([end], [at], [usual])
            for end, at, usual in zip(ends, at_um, errors, strict=True)
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """A plane through values over displacements, K axes of them."""

    mean: FloatArray  # (K,), at the displacement 0
    left: FloatArray  # (K,), sum of squares that it leaves
    freedom: int
    scale: float  # of the mean's variance over that of a value


def plane_of(values: Poses, at_um: Poses) -> Plane:
    """Return the plane through values, in so far as displacements differ."""
    numbers = np.array(list(values.values()))
    matrix = np.array([[1.0, *at_um[trial]] for trial in values])
    found, _, rank, _ = np.linalg.lstsq(matrix, numbers, rcond=None)
    left = ((numbers - matrix @ found) ** 2).sum(axis=0)
    scale = float(np.linalg.pinv(matrix.T @ matrix)[0, 0])
    return Plane(
        mean=found[0], left=left, freedom=len(numbers) - int(rank), scale=scale
    )


def student(freedom: int) -> float:
    """Return Student's two-sided 95 % quantile."""
    return float(special.stdtrit(freedom, _SHARE))


def changes(
    ends: Sequence[Poses], at_um: Sequence[Poses], errors: Sequence[Poses]
) -> Changes:
    """Return differences pose by pose, each without the mean of its end."""
    found = {}
    for values, places, usual in zip(ends, at_um, errors, strict=True):
        mean = np.mean(list(values.values()), axis=0)
        for trial, value in values.items():
            found[trial] = PosedChange(
                at_um=places[trial], error=usual[trial], change=value - mean
            )
    return found


def pooled(values: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return the standard deviation about each group's own mean, (K,) um or rad."""
    groups = [np.array(each) for each in values]
    rest = np.sum([((g - g.mean(axis=0)) ** 2).sum(axis=0) for g in groups], axis=0)
    found: FloatArray = np.sqrt(rest / (sum(map(len, groups)) - len(groups)))
    return found
