"""Record of the random trials that a look's sigma and bias come from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bounds import NORMAL_KURTOSIS, Estimate, half_width
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import is_wrong
from microplan.schemas import plan as p


def undetected(case: LookCase, outcomes: Sequence[Outcome], gates: p.Gates) -> int:
    """Return how many wrong answers the gates of a measurement accept."""
    return sum(
        is_wrong(case, o)
        and (o.score or 0.0) >= gates.min_score
        and (o.spread_um or 0.0) <= (gates.max_spread_um or math.inf)
        for o in outcomes
    )


def repeatability_record(found: ChainScore, undetected: int) -> p.Repeatability:
    """Return what random trials said of a chain, or of a set, as the plan has it."""
    axes = [axis for axis in (found.x, found.y, found.along) if axis is not None]
    theta = found.theta
    return p.Repeatability(
        trials=found.trials,
        answered=found.success,
        undetected=undetected,
        sigma_um=_on_axes(found, lambda axis: axis.sigma),
        kurtosis=max((axis.kurtosis for axis in axes), default=NORMAL_KURTOSIS),
        half_width_um=_on_axes(found, half_width),
        kurtosis_theta=None if theta is None else theta.kurtosis,
        bias_theta_rad=None if theta is None else theta.mean,
        half_width_theta_rad=None if theta is None else half_width(theta),
    )


def _on_axes(
    found: ChainScore, value: Callable[[Estimate], float]
) -> tuple[float, float]:
    """Return a number of each axis of the target's frame, of one direction its parts.

    0 where nothing was answered.
    """
    if found.along is not None and found.axis_rad is not None:
        length = value(found.along)
        c, s = math.cos(found.axis_rad), math.sin(found.axis_rad)
        return (length * abs(c), length * abs(s))
    if found.x is None or found.y is None:
        return (0.0, 0.0)
    return (value(found.x), value(found.y))
