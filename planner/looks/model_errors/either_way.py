"""Statistics of an unknown that acts in the world, whose opposite is as likely."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.answer_shift import (
    AnswerShift,
    Poses,
    changes,
    plane_of,
    pooled,
    student,
)

Angles = Mapping[int, float]  # by the number of a trial, rad


def either_way(
    ends: Sequence[Poses],
    at_um: Sequence[Poses],
    errors: Sequence[Poses],
    angles_rad: Angles | None = None,
) -> AnswerShift:
    """Return the statistics of differences by components of one unknown.

    Parameters
    ----------
    ends : sequence of mapping of int to (K,) float array
        Differences along K axes of the target by the trial's number, by each component
        at the end of its interval; at the other end they are the opposite.
    at_um, errors : sequences of mapping of int to float array
        As in `answer_shift.difference`.
    angles_rad : mapping of int to float, optional
        How far the target's frame is turned in each trial: the unknown keeps its
        direction in the world. K is 2 then.

    Returns
    -------
    AnswerShift
        About 0. Components share one size: the root of the sum of their squares is the
        most that the unknown changes. Of a displacement in the world the larger axis'
        counts for both, so that it holds at any angle of the target.

    Notes
    -----
    What is left of a difference without its mean in the world is a standard deviation.
    """
    stays = [
        {t: turned(value, angles_rad, t, 1) for t, value in end.items()} for end in ends
    ]
    planes = [plane_of(*each) for each in zip(stays, at_um, strict=True)]
    sizes = [
        np.abs(p.mean)
        + student(max(p.freedom, 1)) * np.sqrt(p.left / max(p.freedom, 1) * p.scale)
        for p in planes
    ]
    left = [
        {t: v - turned(p.mean, angles_rad, t, -1) for t, v in end.items()}
        for end, p in zip(ends, planes, strict=True)
    ]
    is_placed = angles_rad is not None
    return AnswerShift(
        pairs=min(len(end) for end in ends),
        freedom=max(min(p.freedom for p in planes), 1),
        mean=np.zeros_like(planes[0].mean),
        half_width=_together(sizes, is_placed=is_placed),
        interval=_together([p.mean for p in planes], is_placed=is_placed),
        sigma=pooled([list(end.values()) for end in left]),
        changes=tuple(
            changes([end], [at], [usual])
            for end, at, usual in zip(left, at_um, errors, strict=True)
        ),
    )


def turned(
    value: FloatArray, angles_rad: Angles | None, trial: int, sign: int
) -> FloatArray:
    """Return (K,) turned by so many times a trial's angle; as it is if none is given.

    With +1 from the target's frame to the world's.
    """
    if angles_rad is None:
        return value
    angle = sign * angles_rad[trial]
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * value[0] - s * value[1], s * value[0] + c * value[1]])


def _together(values: Sequence[FloatArray], *, is_placed: bool) -> FloatArray:
    """Return the root of the sum of squares, (K,); of places that of the worse axis."""
    found: FloatArray = np.sqrt(np.sum(np.square(values), axis=0))
    return np.full_like(found, found.max()) if is_placed else found
