"""Cost of image-model errors: mean, half-width and standard deviation from pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.image_pairs import PairedAnswer
from microplan.planner.looks.model_errors.used_poses import LEAST
from microplan.schemas.plan import EffectCost, ModelCost

_SHARE = 0.975  # below a two-sided 95 % half-width


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Difference of two answers along some axes, over poses: arrays of an entry each.

    Of an interval the mean is the middle of both ends'.
    """

    pairs: int
    mean: FloatArray
    half_width: FloatArray  # two-sided 95 %, with the interval
    interval: FloatArray  # half of the distance between both ends' means
    sigma: FloatArray  # at an end, over poses


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectDifference:
    """What one better model changes of a chain's answers."""

    model: BetterModel
    place: Difference  # um, both axes of the target's frame
    turn: Difference | None  # rad; None: no angle is measured
    image_error: float  # largest difference of the images, share of full scale

    @property
    def cost(self) -> EffectCost:
        """Return it as the plan has it."""
        place = self.place
        return EffectCost(
            by=self.model.by,
            pairs=place.pairs,
            bias_um=_pair(place.mean),
            half_width_um=_pair(place.half_width),
            sigma_um=_pair(place.sigma),
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
        return f"{wrong} of {len(answers)} better images are answered wrongly"
    ends = [
        [a for a in answers if a.end == end and a.off_um is not None]
        for end in range(len(model.ends))
    ]
    fault = _too_few(model, ends, len(answers))
    if fault:
        return fault
    turns = [[a.turn_rad for a in end if a.turn_rad is not None] for end in ends]
    full = all(len(t) == len(e) for t, e in zip(turns, ends, strict=True))
    return EffectDifference(
        model=model,
        place=difference(
            [np.array([a.off_um for a in end]) for end in ends],
            is_apart=model.alternates,
        ),
        turn=difference(
            [np.array(t)[:, None] for t in turns], is_apart=model.alternates
        )
        if full
        else None,
        image_error=max(a.image_error for a in answers),
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


def difference(ends: Sequence[FloatArray], *, is_apart: bool) -> Difference:
    """Return the statistics of differences at one end, or at both of an interval.

    Parameters
    ----------
    ends : sequence of (N, K) float array
        Differences along K axes over N poses; at each end at least two.
    is_apart : bool
        Whether the ends were tried at poses of their own; else at the same ones.

    Notes
    -----
    The mean's half-width is Student's. The middle of two ends and half their distance
    are each known so well: both count.
    """
    if any(len(end) < 2 for end in ends):
        raise ValueError("an end needs at least two poses")
    means = [end.mean(axis=0) for end in ends]
    counts = [len(end) for end in ends]
    rest = sum(((end - mean) ** 2).sum(axis=0)
               for end, mean in zip(ends, means, strict=True))  # fmt: skip
    sigma: FloatArray = np.sqrt(rest / (sum(counts) - len(ends)))
    if len(ends) == 1:
        free, error = counts[0] - 1, sigma / math.sqrt(counts[0])
    elif is_apart:
        free = sum(counts) - len(ends)
        # of the middle, and of half the distance
        error = sigma * math.sqrt(sum(1 / n for n in counts)) / len(ends) * 2
    else:
        free, error = min(counts) - 1, 2 * sigma / math.sqrt(min(counts))
    interval: FloatArray = (np.max(means, axis=0) - np.min(means, axis=0)) / 2
    return Difference(
        pairs=sum(counts) if is_apart else min(counts),
        mean=np.mean(means, axis=0),
        half_width=interval + float(special.stdtrit(free, _SHARE)) * error,
        interval=interval,
        sigma=sigma,
    )


def model_cost(found: Sequence[EffectDifference]) -> ModelCost | None:
    """Return what all effects cost together, None of none.

    Poses are the same for all of them: half-widths and standard deviations add up.
    """
    if not found:
        return None
    places, turns = [each.place for each in found], [each.turn for each in found]
    known = [turn for turn in turns if turn is not None]
    is_turned = len(known) == len(found)
    return ModelCost(
        pairs=min(place.pairs for place in places),
        bias_um=_pair(_sum([place.mean for place in places])),
        half_width_um=_pair(_sum([place.half_width for place in places])),
        interval_um=_pair(_sum([place.interval for place in places])),
        sigma_um=_pair(_sum([place.sigma for place in places])),
        bias_theta_rad=_one([t.mean for t in known]) if is_turned else None,
        half_width_theta_rad=_one([t.half_width for t in known]) if is_turned else None,
        interval_theta_rad=_one([t.interval for t in known]) if is_turned else None,
        sigma_theta_rad=_one([t.sigma for t in known]) if is_turned else None,
    )


def of_either(one: ModelCost | None, other: ModelCost | None) -> ModelCost | None:
    """Return the cost of a chain with the half-widths of its fallback, if wider."""
    if one is None or other is None:
        return one
    wider = [
        tuple(max(pair) for pair in zip(a, b, strict=True))
        for a, b in (
            (one.half_width_um, other.half_width_um),
            (one.interval_um, other.interval_um),
            (one.sigma_um, other.sigma_um),
        )
    ]
    half, interval, sigma = wider
    return replace(
        one,
        half_width_um=(half[0], half[1]),
        interval_um=(interval[0], interval[1]),
        sigma_um=(sigma[0], sigma[1]),
    )


def together_cost(
    parts: Sequence[ModelCost | None], apart_um: float
) -> ModelCost | None:
    """Return what the features of a set cost its place and angle, at most.

    Each feature's own bias is taken off. A mean with weights errs by no more than the
    worst of them, on either axis; an angle by two such errors over their distance
    `apart_um`.
    """
    known = [part for part in parts if part is not None]
    if not known:
        return None
    half, interval, sigma = (
        max(max(value) for value in values)
        for values in (
            [part.half_width_um for part in known],
            [part.interval_um for part in known],
            [part.sigma_um for part in known],
        )
    )
    turn = 2 / apart_um if apart_um > 0 else None
    own = [part for part in known if part.half_width_theta_rad is not None]
    return ModelCost(
        pairs=min(part.pairs for part in known),
        bias_um=(0.0, 0.0),
        half_width_um=(half, half),
        interval_um=(interval, interval),
        sigma_um=(sigma, sigma),
        bias_theta_rad=_most(own, "bias_theta_rad", 0.0, turn),
        half_width_theta_rad=_most(own, "half_width_theta_rad", half, turn),
        interval_theta_rad=_most(own, "interval_theta_rad", interval, turn),
        sigma_theta_rad=_most(own, "sigma_theta_rad", sigma, turn),
    )


def _most(
    own: Sequence[ModelCost], name: str, place_um: float, turn: float | None
) -> float | None:
    """Return the largest of features' own angles and of that of their places."""
    values = [abs(float(getattr(part, name) or 0.0)) for part in own]
    if turn is not None:
        values.append(turn * place_um)
    return max(values, default=None)


def _sum(values: Sequence[FloatArray]) -> FloatArray:
    total: FloatArray = np.sum(values, axis=0)
    return total


def _one(values: Sequence[FloatArray]) -> float:
    return float(_sum(values)[0])


def _pair(values: FloatArray) -> tuple[float, float]:
    x, y = values.tolist()
    return (x, y)
