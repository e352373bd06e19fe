"""Cost of image-model errors: mean, half-width and standard deviation from pairs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.added_variance import (
    Changes,
    PosedChange,
    added_variance,
)
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.image_pairs import PairedAnswer
from microplan.planner.looks.model_errors.used_poses import LEAST
from microplan.schemas.plan import EffectCost, ModelCost

WRONG = "answered wrongly"  # in words of why a cost is open: more poses do not help
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


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptedRange:
    """What right answers on better images say of themselves, at the extremes."""

    least_score: float = math.inf
    widest_um: float = 0.0  # standard deviation

    @classmethod
    def of(cls, ranges: Iterable[AcceptedRange]) -> AcceptedRange:
        """Return what holds all of some."""
        found = tuple(ranges)
        return cls(
            least_score=min((r.least_score for r in found), default=math.inf),
            widest_um=max((r.widest_um for r in found), default=0.0),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectDifference:
    """What one better model changes of a chain's answers."""

    model: BetterModel
    place: AnswerShift  # um, both axes of the target's frame
    turn: AnswerShift | None  # rad; None: no angle is measured
    image_error: float  # largest difference of the images, share of full scale
    accepted: AcceptedRange = field(default_factory=AcceptedRange)

    @property
    def cost(self) -> EffectCost:
        """Return it as the plan has it: the errors of trials have what they draw."""
        place, share = self.place, 0.0 if self.model.is_drawn else 1.0
        return EffectCost(
            by=self.model.by,
            pairs=place.pairs,
            bias_um=_pair(share * place.mean),
            half_width_um=_pair(place.half_width),
            sigma_um=_pair(share * place.sigma),
        )


def effect_difference(
    model: BetterModel, answers: Sequence[PairedAnswer]
) -> EffectDifference | str:
    """Return what a better model changes of one chain's answers, or why that is open.

    Parameters
    ----------
    model : BetterModel
        The other side of the pairs.
    answers : sequence of PairedAnswer
        Of this chain and model alone.

    Returns
    -------
    EffectDifference or str
        Words where the better images are answered wrongly, or too few pairs at all.
    """
    wrong = sum(a.failure == "wrong" for a in answers)
    if wrong:
        return f"{wrong} of {len(answers)} better images are {WRONG}"
    ends = [
        [a for a in answers if a.end == end and a.off_um is not None]
        for end in range(len(model.ends))
    ]
    fault = _too_few(model, ends, len(answers))
    if fault:
        return fault
    full = all(a.turn_rad is not None for end in ends for a in end)
    at_um = [{a.trial: np.array(a.at_um) for a in end} for end in ends]
    places = [{a.trial: np.array(a.off_um) for a in end} for end in ends]
    turns = [{a.trial: np.array([a.turn_rad]) for a in end} for end in ends]
    errors = [{a.trial: np.array(a.error_um) for a in end} for end in ends]
    angles = [{a.trial: np.array([a.error_rad]) for a in end} for end in ends]
    apart = model.alternates
    return EffectDifference(
        model=model,
        place=difference(places, at_um, errors, is_apart=apart),
        turn=difference(turns, at_um, angles, is_apart=apart) if full else None,
        image_error=max(a.image_error for a in answers),
        accepted=AcceptedRange(
            least_score=min(
                (a.score for a in answers if a.score is not None), default=math.inf
            ),
            widest_um=max(
                (a.spread_um for a in answers if a.spread_um is not None), default=0.0
            ),
        ),
    )


def _too_few(
    model: BetterModel, ends: Sequence[Sequence[PairedAnswer]], asked: int
) -> str:
    """Return that too few pairs were answered, "" if enough were."""
    counts = [len(end) for end in ends]
    is_split = model.alternates and len(ends) > 1
    has = sum(counts) if is_split else min(counts)
    if has >= LEAST and min(counts) >= LEAST // 2:
        return ""
    return f"{has} of {asked} pairs are answered, {LEAST} are needed"


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
    planes = [_plane(*each) for each in zip(ends, at_um, strict=True)]
    means = [plane.mean for plane in planes]
    free = max(sum(plane.freedom for plane in planes), 1)
    left = np.sqrt(np.sum([plane.left for plane in planes], axis=0) / free)
    error = left * math.sqrt(sum(p.scale for p in planes)) / len(planes)
    interval: FloatArray = (np.max(means, axis=0) - np.min(means, axis=0)) / 2
    return AnswerShift(
        pairs=sum(len(end) for end in ends),
        freedom=free,
        mean=np.mean(means, axis=0),
        half_width=interval + len(ends) * _student(free) * error,
        interval=interval,
        sigma=_pooled([list(end.values()) for end in ends]),
        changes=(_changes(ends, at_um, errors),),
    )


def _of_both(
    ends: Sequence[Poses], at_um: Sequence[Poses], errors: Sequence[Poses]
) -> AnswerShift:
    """Return the statistics of an interval whose ends were tried at the same poses."""
    low, high = ends
    both = [trial for trial in low if trial in high]
    middle = _plane({k: (low[k] + high[k]) / 2 for k in both}, at_um[0])
    apart = _plane({k: (high[k] - low[k]) / 2 for k in both}, at_um[0])
    interval: FloatArray = np.abs(apart.mean)
    free = max(middle.freedom, 1)
    error = sum(np.sqrt(each.left / free * each.scale) for each in (middle, apart))
    return AnswerShift(
        pairs=len(both),
        freedom=free,
        mean=middle.mean,
        half_width=interval + _student(free) * error,
        interval=interval,
        sigma=_pooled([list(end.values()) for end in ends]),
        changes=tuple(
            _changes([end], [at], [usual])
            for end, at, usual in zip(ends, at_um, errors, strict=True)
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plane:
    """A plane through values over displacements, K axes of them."""

    mean: FloatArray  # (K,), at the displacement 0
    left: FloatArray  # (K,), sum of squares that it leaves
    freedom: int
    scale: float  # of the mean's variance over that of a value


def _plane(values: Poses, at_um: Poses) -> _Plane:
    """Return the plane through values, in so far as displacements differ."""
    numbers = np.array(list(values.values()))
    matrix = np.array([[1.0, *at_um[trial]] for trial in values])
    found, _, rank, _ = np.linalg.lstsq(matrix, numbers, rcond=None)
    left = ((numbers - matrix @ found) ** 2).sum(axis=0)
    scale = float(np.linalg.pinv(matrix.T @ matrix)[0, 0])
    return _Plane(
        mean=found[0], left=left, freedom=len(numbers) - int(rank), scale=scale
    )


def _student(freedom: int) -> float:
    """Return Student's two-sided 95 % quantile."""
    return float(special.stdtrit(freedom, _SHARE))


def _changes(
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


def _pooled(values: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return the standard deviation about each group's own mean, (K,)."""
    groups = [np.array(each) for each in values]
    rest = np.sum([((g - g.mean(axis=0)) ** 2).sum(axis=0) for g in groups], axis=0)
    found: FloatArray = np.sqrt(rest / (sum(map(len, groups)) - len(groups)))
    return found


def model_cost(found: Sequence[EffectDifference]) -> ModelCost | None:
    """Return what all effects cost together, None of none.

    Poses are the same for all of them: half-widths add up, and so would standard
    deviations at most.
    """
    if not found:
        return None
    is_turned = all(each.turn is not None for each in found)
    paid = [each for each in found if not each.model.is_drawn]
    places, known = _shifts(paid)
    drawn, drawn_turns = _shifts([each for each in found if each.model.is_drawn])
    added, turned = _added(places), _added(known)
    return ModelCost(
        pairs=min(each.place.pairs for each in found),
        freedom=min(each.place.freedom for each in found),
        bias_um=_pair(_sum([place.mean for place in places])),
        half_width_um=_pair(_sum([place.half_width for place in places])),
        interval_um=_pair(_sum([place.interval for place in places])),
        sigma_um=_pair(np.sqrt(np.maximum(added, 0.0))),
        spared_um=_pair(np.sqrt(np.maximum(-added, 0.0))),
        spread_um=_pair(_sum([place.sigma for place in places])),
        bias_theta_rad=_one([t.mean for t in known]) if is_turned else None,
        half_width_theta_rad=_one([t.half_width for t in known]) if is_turned else None,
        interval_theta_rad=_one([t.interval for t in known]) if is_turned else None,
        sigma_theta_rad=math.sqrt(max(turned[0], 0.0)) if is_turned else None,
        spread_theta_rad=_one([t.sigma for t in known]) if is_turned else None,
        drawn_um=_pair(_sum([place.half_width for place in drawn])),
        drawn_theta_rad=_one([t.half_width for t in drawn_turns])
        if is_turned
        else None,
    )


def _shifts(
    found: Sequence[EffectDifference],
) -> tuple[list[AnswerShift], list[AnswerShift]]:
    """Return the shifts of places, and of angles where they are measured."""
    turns = [each.turn for each in found if each.turn is not None]
    return [each.place for each in found], turns


def _added(shifts: Sequence[AnswerShift]) -> FloatArray:
    """Return by how much shifts change variances, at the worse ends.

    Their sum's square where poses in common are too few.
    """
    most = _sum([shift.sigma for shift in shifts]) ** 2
    if not shifts or not all(shift.changes for shift in shifts):
        return most
    ends = max(len(shift.changes) for shift in shifts)
    found = [
        added_variance([shift.changes[end % len(shift.changes)] for shift in shifts])
        for end in range(ends)
    ]
    known = [each for each in found if each is not None]
    return np.asarray(np.max(known, axis=0)) if len(known) == ends else most


def _sum(values: Sequence[FloatArray]) -> FloatArray:
    return np.sum(values, axis=0) if values else np.zeros(2)


def _one(values: Sequence[FloatArray]) -> float:
    return float(_sum(values)[0])


def _pair(values: FloatArray) -> tuple[float, float]:
    x, y = values.tolist()
    return (x, y)
