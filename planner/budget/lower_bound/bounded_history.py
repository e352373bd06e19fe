"""Measurement history with each measured sigma at its upper bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.lower_bound.sample_bounds import (
    half_width_factor,
    sigma_factor,
)
from microplan.planner.budget.measurement_history import MeasurementHistory


def bounded_history(history: MeasurementHistory, doubt: float) -> MeasurementHistory:
    """Return the history with measured sigmas at their upper bounds, each at `doubt`.

    What is stated stays as it is stated.
    """

    def all_of(found: Mapping[str, PastMeasurement]) -> dict[str, PastMeasurement]:
        return {name: bounded(seen, doubt) for name, seen in found.items()}

    before = history.before
    return replace(
        history,
        seen=all_of(history.seen),
        angles=all_of(history.angles),
        before=None if before is None else bounded(before, doubt),
    )


def bounded(seen: PastMeasurement, doubt: float) -> PastMeasurement:
    """Return a measurement with its sigmas at their upper bounds.

    One whose trials are not known is taken as stated.
    """
    known = seen.repeatability
    if known is None:
        return seen
    factor = sigma_factor(known.answered, known.kurtosis, doubt)
    turn = seen.sigma_theta_rad
    if turn is not None and known.kurtosis_theta is not None:
        turn *= sigma_factor(known.answered, known.kurtosis_theta, doubt)
    own_um = seen.sigma_without_scale_um
    return replace(
        seen,
        sigma_um=_grown(seen.sigma_um, seen.moved_um, factor),
        sigma_without_scale_um=None
        if own_um is None
        else _grown(own_um, seen.moved_um, factor),
        sigma_theta_rad=turn,
    )


def _grown(sigma_um: float, moved_um: float, factor: float) -> float:
    """Return sigma with what was measured of it grown, what moves add left alone."""
    if math.isinf(sigma_um):
        return sigma_um
    measured_um = math.sqrt(max(sigma_um**2 - moved_um**2, 0.0))
    return math.hypot(factor * measured_um, moved_um) if measured_um > 0 else moved_um


def bias_um(seen: PastMeasurement | None, doubt: float) -> float:
    """Return how far a measurement's bias may be from the one taken off, um.

    The corner of the box of both axes, each at `doubt`.
    """
    known = None if seen is None else seen.repeatability
    if known is None:
        return 0.0
    return half_width_factor(known.answered, doubt) * math.hypot(*known.half_width_um)


def bias_rad(seen: PastMeasurement | None, doubt: float) -> float:
    """Return how far the bias of a measured angle may be from 0, rad.

    Nothing takes it off, so that all of it counts, with what coherence may add.
    """
    if seen is None:
        return 0.0
    known = seen.repeatability
    if known is None or known.half_width_theta_rad is None:
        return seen.coherence_rad
    half_rad = half_width_factor(known.answered, doubt) * known.half_width_theta_rad
    return abs(known.bias_theta_rad or 0.0) + half_rad + seen.coherence_rad
