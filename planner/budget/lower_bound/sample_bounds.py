"""Ends of what trials leave open of a variance, a bias, a rate of failures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy import stats

from microplan.featuresel.trials.bounds import freedom
from microplan.schemas.plan import Repeatability

RECORDED = 0.975  # share below the half-width that a plan records: two-sided 95 %
# Share of the doubt that the rate of failures has: it costs most of the bound, and ends
# of measured numbers move little with theirs.
_OF_RATE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """How the doubt of a bound is split."""

    confidence: float  # of the whole bound, in 0..1
    terms: int  # measured numbers of which the bound takes an end, at least 1

    def __post_init__(self) -> None:
        if not (0 < self.confidence < 1 and self.terms >= 1):
            raise ValueError(f"need confidence in 0..1 and terms >= 1, got {self}")

    @property
    def rate_doubt(self) -> float:
        """Return the doubt that the rate of undetected failures has: most of it."""
        return _OF_RATE * (1 - self.confidence)

    @property
    def term_doubt(self) -> float:
        """Return the doubt of each measured number: they share the rest."""
        return (1 - _OF_RATE) * (1 - self.confidence) / self.terms


def sigma_factor(count: int, kurtosis: float, doubt: float) -> float:
    """Return the upper bound of a standard deviation over the sample's.

    Parameters
    ----------
    count : int
        Values that the sample has; below two nothing is known.
    kurtosis : float
        Of the values, as `microplan.featuresel.trials.bounds.kurtosis` has it.
    doubt : float
        Probability that the true one is larger.

    Returns
    -------
    float
        sqrt(nu / chi2), at least 1; nu = 2 n / (kurtosis - 1) of many values, at most
        that of normal ones.
    """
    if count < 2:
        return math.inf
    nu = freedom(count, kurtosis)
    return max(1.0, math.sqrt(nu / float(stats.chi2.ppf(doubt, nu))))


def half_width_factor(count: int, doubt: float) -> float:
    """Return the half-width of a bias over the one that a plan records.

    `doubt` is that of both sides together.
    """
    if count < 2:
        return math.inf
    wanted, recorded = (
        float(stats.t.ppf(share, count - 1)) for share in (1 - doubt / 2, RECORDED)
    )
    return wanted / recorded


def undetected_upper(
    looks: Sequence[tuple[float, Repeatability]], doubt: float
) -> float:
    """Return the upper bound of the probability that a run has an undetected failure.

    Parameters
    ----------
    looks : sequence of (float, Repeatability)
        How often a run looks, and what its random trials said, kind by kind.
    doubt : float
        Probability that the true one is larger.

    Notes
    -----
    A look of kind i fails undetected with probability q_i: a run does with at most
    sum m_i q_i <= max(m_i / n_i) sum n_i q_i. The trials' failures k are Poisson with
    the mean sum n_i q_i (a binomial is less dispersed), whose upper end is half a
    quantile of chi-square with 2 k + 2 degrees of freedom (Garwood 1936).
    """
    if not looks:
        return 0.0
    if any(found.trials < 1 for _, found in looks):
        return 1.0
    failed = sum(found.undetected for _, found in looks)
    share = max(many / found.trials for many, found in looks)
    mean = float(stats.chi2.ppf(1 - doubt, 2 * failed + 2)) / 2
    return min(1.0, share * mean)
