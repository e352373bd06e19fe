"""Cost of image-model errors: what better images change of answers, all together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.added_variance import added_variance
from microplan.planner.looks.model_errors.answer_shift import (
    AnswerShift,
    Poses,
    difference,
)
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.either_way import Angles, either_way
from microplan.planner.looks.model_errors.image_pairs import PairedAnswer
from microplan.planner.looks.model_errors.used_poses import LEAST
from microplan.schemas.plan import EffectCost, ModelCost

WRONG = "answered wrongly"  # in words of why a cost is open: more poses do not help


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
    frames = {a.trial: a.angle_rad for a in answers}
    return EffectDifference(
        model=model,
        place=_shift(model, places, at_um, errors, frames),
        turn=_shift(model, turns, at_um, angles) if full else None,
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


def _shift(
    model: BetterModel,
    ends: Sequence[Poses],
    at_um: Sequence[Poses],
    errors: Sequence[Poses],
    frames_rad: Angles | None = None,
) -> AnswerShift:
    """Return the statistics of differences at a model's ends."""
    if model.is_either_way:
        return either_way(ends, at_um, errors, frames_rad)
    return difference(ends, at_um, errors, is_apart=model.alternates)


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


def model_cost(found: Sequence[EffectDifference]) -> ModelCost | None:
    """Return what all effects cost together, None of none.

    Half-widths add up, and so would standard deviations at most: those of models that
    went on to more poses than the least do with those of the others.
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
    groups = [[s for s in shifts if s.goes_on is each] for each in (True, False)]
    found = [_added_together(group) for group in groups if group]
    more = _sum([np.sqrt(np.maximum(each, 0.0)) for each in found])
    less = _sum([np.minimum(each, 0.0) for each in found])
    return np.asarray(more**2 + less)


def _added_together(shifts: Sequence[AnswerShift]) -> FloatArray:
    """Return the same of shifts at as many poses, at least one."""
    most = _sum([shift.sigma for shift in shifts]) ** 2
    if not all(shift.changes for shift in shifts):
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
