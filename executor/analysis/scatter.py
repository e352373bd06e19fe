"""What several answers say of a prediction: shares and spreads, with their bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.executor.analysis.distributions import (
    binomial_at_most,
    binomial_bounds,
    chi_square_above,
    chi_square_quantile,
    student_quantile,
)

LEVEL = 0.95  # of every interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """How many of some trials succeeded, beside the chance predicted."""

    hits: int
    trials: int
    low: float  # interval of chances that do not refute it
    high: float
    predicted: float
    chance: float  # of so few, if at least the prediction holds


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredScatter:
    """A standard deviation per axis, beside the one predicted."""

    freedom: int
    sigma: float
    low: float
    high: float
    predicted: float
    chi_square: float  # against `predicted`
    most: float  # what the prediction's own trials leave open
    chance: float  # of so much, if sigma is `most`


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """A mean with its interval."""

    count: int
    mean: float
    low: float
    high: float


def share(hits: int, trials: int, predicted: float) -> Share:
    """Return what `hits` in `trials` say of a predicted chance."""
    low, high = binomial_bounds(hits, trials, LEVEL) if trials else (0.0, 1.0)
    return Share(
        hits=hits,
        trials=trials,
        low=low,
        high=high,
        predicted=predicted,
        chance=binomial_at_most(hits, trials, predicted),
    )


def spread(
    squares: float, freedom: int, predicted: float, most: float | None = None
) -> MeasuredScatter:
    """Return what a sum of squared deviations says of a predicted sigma.

    Parameters
    ----------
    squares : float
        Sum over deviations, units of sigma squared.
    freedom : int
        How many of them are free, at least 1.
    predicted : float
        Standard deviation.
    most : float, optional
        Its upper bound, where the prediction comes from trials.
    """
    limit = max(predicted, most or 0.0)
    tail = (1 - LEVEL) / 2
    return MeasuredScatter(
        freedom=freedom,
        sigma=math.sqrt(squares / freedom),
        low=math.sqrt(squares / chi_square_quantile(1 - tail, freedom)),
        high=math.sqrt(squares / chi_square_quantile(tail, freedom)),
        predicted=predicted,
        chi_square=squares / predicted**2 if predicted > 0 else math.inf,
        most=limit,
        chance=chi_square_above(squares / limit**2, freedom) if limit > 0 else 0.0,
    )


def mean(values: Sequence[float]) -> Mean:
    """Return a mean with Student's interval; that of one value is itself."""
    count = len(values)
    middle = sum(values) / count
    if count < 2:
        return Mean(count=count, mean=middle, low=-math.inf, high=math.inf)
    sd = math.sqrt(sum((v - middle) ** 2 for v in values) / (count - 1))
    half = student_quantile((1 + LEVEL) / 2, count - 1) * sd / math.sqrt(count)
    return Mean(count=count, mean=middle, low=middle - half, high=middle + half)
