"""The final error that a plan's budget predicts, and the bounds of a measured one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import beta, binom

from microplan.arrays import FloatArray

CONFIDENCE = 0.95
DRAWS = 1_000_000  # a quantile's own noise is then below .3 % of it
NOTHING_LOST = 700.0  # exp of more is no double
EVEN = 100.0  # a law this much wider than its cut is even inside it


def predicted_um(plan: dict[str, Any], share: float, seed: int = 0) -> float:
    """Return the radius within which `share` of all insertions end, by the plan, um.

    The budget of the insertion is drawn from, which its compiler integrates: what the
    servo leaves (normal, cut off at the alignment's tolerance, of the stated root mean
    square per axis) and the normal rest of the stated covariance.

    Parameters
    ----------
    plan : dict
        A plan.json with one insertion behind an alignment by servo.
    share : float
        In 0..1.
    seed : int
        Of the draws.
    """
    steps = plan["steps"]
    at = next(k for k, step in enumerate(steps) if step["verb"] == "insert")
    control = next(s["control"] for s in reversed(steps[:at]) if s["control"])
    budget = steps[at]["budget"]
    rng = np.random.default_rng(seed)
    left_um = budget["rows"][0]["sigma_um"]
    left = cut_off(left_um, control["tolerance_xy_um"], DRAWS, rng)
    xx, xy, yy = budget["analysis"]["covariance_um2"]
    rest = rng.multivariate_normal((0.0, 0.0), [[xx, xy], [xy, yy]], DRAWS)
    return float(np.quantile(np.hypot(*(left + rest).T), share))


def cut_off(
    rms_um: float, within_um: float, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return draws of a normal law cut off at a circle, (count, 2) um.

    `rms_um` is what is left per axis. With a = t**2 / (2 s**2) for the cut t and the
    law's own sigma s, that is s**2 (1 - a / (exp(a) - 1)), at most t**2 / 4.
    """
    most_um = within_um / 2

    def over(sigma_um: float) -> float:
        a = within_um**2 / (2 * sigma_um**2)
        lost = a / math.expm1(a) if a < NOTHING_LOST else 0.0
        return sigma_um * math.sqrt(1 - lost) - rms_um

    sigma_um = EVEN * within_um
    if rms_um < most_um * (1 - 1 / EVEN**2):
        # the cut only takes away: the law's own sigma is no less than what is left
        sigma_um = rms_um if over(rms_um) >= 0 else brentq(over, rms_um, sigma_um)
    a = within_um**2 / (2 * sigma_um**2)
    radius_um = sigma_um * np.sqrt(-2 * np.log1p(rng.random(count) * math.expm1(-a)))
    angle_rad = rng.uniform(0, math.tau, count)
    return np.stack(
        [radius_um * np.cos(angle_rad), radius_um * np.sin(angle_rad)], axis=1
    )


def quantile_bounds(values: Sequence[float], share: float) -> tuple[float, float]:
    """Return bounds of a quantile from a sample, two-sided, by order statistics.

    The number of values below the true quantile is binomial, whatever their law. Too
    few values bound one side only: the other is their own end.
    """
    ordered, tail = np.sort(values), (1 - CONFIDENCE) / 2
    count = len(ordered)
    low = int(binom.ppf(tail, count, share)) - 1
    high = int(binom.ppf(1 - tail, count, share))
    return float(ordered[max(low, 0)]), float(ordered[min(high, count - 1)])


def share_bounds(good: int, count: int) -> tuple[float, float]:
    """Return Clopper and Pearson's bounds of a share, two-sided."""
    tail = (1 - CONFIDENCE) / 2
    low = float(beta.ppf(tail, good, count - good + 1)) if good else 0.0
    high = float(beta.ppf(1 - tail, good + 1, count - good)) if good < count else 1.0
    return low, high
