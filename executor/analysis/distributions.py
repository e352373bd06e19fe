"""Statistical tests of shares or standard deviations, with their distributions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

LEVEL = 0.95  # of every interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """Share of trials that succeeded, with the predicted probability."""

    hits: int
    trials: int
    low: float  # interval of probabilities that it does not refute
    high: float
    predicted: float
    chance: float  # of so few, if at least the prediction holds


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredScatter:
    """Standard deviation per axis, with the predicted one."""

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
    """Return the test of a predicted probability by `hits` in `trials`."""
    low, high = binomial_bounds(hits, trials, LEVEL) if trials else (0.0, 1.0)
    return Share(
        hits=hits,
        trials=trials,
        low=low,
        high=high,
        predicted=predicted,
        chance=binomial_at_most(hits, trials, predicted),
    )


def scatter(
    squares: float, freedom: int, predicted: float, most: float | None = None
) -> MeasuredScatter:
    """Return the test of a predicted sigma by a sum of squared deviations.

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


_TINY = 1e-300  # keeps Lentz's ratios finite
_EPS = 1e-15
_TERMS = 10_000  # both expansions need about sqrt(a) terms; a is below 1e7 here


def chi_square_above(value: float, freedom: float) -> float:
    """Return the probability of a chi-square of `freedom` above `value`."""
    return _gamma_above(freedom / 2, value / 2)


@cache
def chi_square_quantile(chance: float, freedom: float) -> float:
    """Return the quantile of a chi-square of `freedom` at the probability `chance`."""
    high = freedom + 10.0
    while chi_square_above(high, freedom) > 1 - chance:
        high *= 2
    return _root(lambda x: 1 - chi_square_above(x, freedom) - chance, 0.0, high)


@cache
def student_quantile(chance: float, freedom: float) -> float:
    """Return the quantile of Student's t of `freedom` at `chance`, .5 or more."""
    high = 2.0
    while 1 - student_above(high, freedom) < chance:
        high *= 2
    return _root(lambda t: 1 - student_above(t, freedom) - chance, 0.0, high)


def student_above(value: float, freedom: float) -> float:
    """Return the probability of Student's t of `freedom` above `value`."""
    if math.isinf(value):
        return 0.0 if value > 0 else 1.0
    tail = beta_below(freedom / 2, 0.5, freedom / (freedom + value * value)) / 2
    return tail if value > 0 else 1 - tail


def binomial_at_most(hits: int, trials: int, chance: float) -> float:
    """Return the binomial probability of `hits` or fewer in `trials` of `chance`."""
    if hits < 0:
        return 0.0
    if hits >= trials:
        return 1.0
    return beta_below(trials - hits, hits + 1, 1 - chance)


@cache
def binomial_bounds(hits: int, trials: int, level: float) -> tuple[float, float]:
    """Return the interval of probabilities that `hits` in `trials` do not refute.

    References
    ----------
    Clopper & Pearson (1934): each bound at (1 - level) / 2.
    """
    tail = (1 - level) / 2

    def below(p: float) -> float:
        return binomial_at_most(hits, trials, p) - tail

    def above(p: float) -> float:
        return 1 - binomial_at_most(hits - 1, trials, p) - tail

    low = 0.0 if hits == 0 else _root(above, 0.0, 1.0)
    high = 1.0 if hits == trials else _root(below, 0.0, 1.0)
    return (low, high)


def beta_below(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function I_x(a, b).

    References
    ----------
    DLMF 8.17.22, evaluated by the modified Lentz method; 8.17.4 beyond the mean.
    """
    if not 0 <= x <= 1:
        raise ValueError(f"x must be 0 to 1, got {x}")
    if x in (0.0, 1.0):
        return x
    if x > (a + 1) / (a + b + 2):
        return 1 - beta_below(b, a, 1 - x)
    log_front = (
        math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
        + a * math.log(x) + b * math.log1p(-x)
    )  # fmt: skip

    def term(k: int) -> float:
        m = k // 2
        if k == 0:
            return 1.0
        if k % 2 == 0:
            return m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        return -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))

    return math.exp(log_front) / a * _fraction(term, lambda _: 1.0)


def _gamma_above(a: float, x: float) -> float:
    """Return the regularised upper incomplete gamma function Q(a, x).

    References
    ----------
    DLMF 8.7.1 (series) below the mean, 8.9.2 (continued fraction) above it.
    """
    if x <= 0:
        return 1.0
    log_front = a * math.log(x) - x - math.lgamma(a)
    if x < a + 1:
        total = part = 1 / a
        for k in range(1, _TERMS):
            part *= x / (a + k)
            total += part
            if part < total * _EPS:
                break
        return 1 - total * math.exp(log_front)

    def term(k: int) -> float:
        return 1.0 if k == 0 else -k * (k - a)

    return math.exp(log_front) * _fraction(term, lambda k: x + 2 * k + 1 - a)


def _fraction(term: Callable[[int], float], lower: Callable[[int], float]) -> float:
    """Return t0 / (l0 + t1 / (l1 + ...)) by the modified Lentz method."""
    found, upper, under = _TINY, _TINY, 0.0
    for k in range(_TERMS):
        under = lower(k) + term(k) * under
        upper = lower(k) + term(k) / upper
        under = 1 / (under if abs(under) > _TINY else _TINY)
        upper = upper if abs(upper) > _TINY else _TINY
        change = upper * under
        found *= change
        if k and abs(change - 1) < _EPS:
            break
    return found


def _root(value: Callable[[float], float], low: float, high: float) -> float:
    """Return where a monotonic function crosses 0, by bisection."""
    rises = value(high) > 0
    for _ in range(200):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if (value(middle) > 0) == rises:
            high = middle
        else:
            low = middle
    return (low + high) / 2
