"""Measurement history with each measured sigma at its upper bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from microplan.featuresel.trials.bounds import NORMAL_KURTOSIS
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.lower_bound.sample_bounds import (
    half_width_factor,
    sigma_factor,
)
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.schemas.plan import ModelCost


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
    known, cost = seen.repeatability, seen.model_cost
    if known is None:
        return seen
    factor = sigma_factor(known.answered, known.kurtosis, doubt)
    grown_um = _model_um(cost, doubt)
    turn = seen.sigma_theta_rad
    if turn and known.kurtosis_theta is not None:
        turn_factor = sigma_factor(known.answered, known.kurtosis_theta, doubt)
        model = 0.0 if cost is None else cost.sigma_theta_rad or 0.0
        own = math.sqrt(max(turn**2 - model**2, 0.0))
        most = 0.0 if cost is None else cost.spread_theta_rad or model
        turn = math.hypot(turn_factor * own, _pairs_factor(cost, doubt) * most)
    own_um = seen.sigma_without_scale_um
    return replace(
        seen,
        sigma_um=_grown(seen, seen.sigma_um, factor, grown_um),
        sigma_without_scale_um=None
        if own_um is None
        else _grown(seen, own_um, factor, grown_um),
        sigma_theta_rad=turn,
    )


def _model_um(cost: ModelCost | None, doubt: float) -> float:
    """Return the upper bound of sigma by errors of images, um.

    All that answers differ by counts: nothing is spared.
    """
    if cost is None:
        return 0.0
    most_um = max(cost.sigma_um if cost.spread_um is None else cost.spread_um)
    return _pairs_factor(cost, doubt) * most_um


def _pairs_factor(cost: ModelCost | None, doubt: float) -> float:
    """Return the upper bound of a sigma from pairs of images over the sample's."""
    if cost is None:
        return 1.0
    return sigma_factor(cost.pairs, NORMAL_KURTOSIS, doubt)


def _grown(
    seen: PastMeasurement, sigma_um: float, factor: float, model_um: float
) -> float:
    """Return one of a measurement's sigmas with what trials measured of it grown.

    What moves add is left alone; errors of images count with their upper bound.
    """
    if math.isinf(sigma_um):
        return sigma_um
    charged_um = math.sqrt(max(sigma_um**2 - seen.moved_um**2, 0.0))
    cost = seen.own_cost or seen.model_cost
    trials_um = charged_um
    if cost is not None:
        true_um = min(seen.trueness_um, charged_um)
        trials_um = cost.trials_um(charged_um, true_um)
    grown_um = factor * trials_um if trials_um > 0 else 0.0
    return math.hypot(grown_um, seen.moved_um, model_um)


def bias_um(seen: PastMeasurement | None, doubt: float) -> float:
    """Return how far a measurement's bias may be from the one taken off, um.

    The corner of the box of both axes, each at `doubt`; inf of fewer than two answers.
    """
    known = None if seen is None else seen.repeatability
    if known is None:
        return 0.0
    if known.answered < 2:
        return math.inf
    return half_width_factor(known.answered, doubt) * math.hypot(*known.half_width_um)


def model_bias_um(seen: PastMeasurement | None, doubt: float) -> float:
    """Return how far the bias by errors of images may be from the one taken off, um.

    What is only known between two ends counts as it is; walls and faces that trials
    draw at their worst.
    """
    cost = None if seen is None else seen.model_cost
    if cost is None:
        return 0.0
    factor = half_width_factor(cost.freedom + 1, doubt)
    axes = zip(cost.half_width_um, cost.interval_um, cost.drawn_um, strict=True)
    sides = [
        between + drawn + (factor * (half - between) if half > between else 0.0)
        for half, between, drawn in axes
    ]
    return math.hypot(*sides)


def bias_rad(seen: PastMeasurement | None, doubt: float) -> float:
    """Return how far the bias of a measured angle may be from 0, rad.

    Nothing takes it off, so that all of it counts, with what errors of images and
    coherence may add.
    """
    if seen is None:
        return 0.0
    known = seen.repeatability
    if known is None or known.half_width_theta_rad is None:
        return seen.edges_rad
    if known.answered < 2:
        return math.inf
    half_rad = half_width_factor(known.answered, doubt) * known.half_width_theta_rad
    found_rad = abs(known.bias_theta_rad or 0.0) + half_rad + seen.edges_rad
    cost = seen.model_cost
    if cost is None or cost.half_width_theta_rad is None:
        return found_rad
    between = cost.interval_theta_rad or 0.0
    more = half_width_factor(cost.freedom + 1, doubt) * (
        cost.half_width_theta_rad - between
    )
    between += cost.drawn_theta_rad or 0.0
    return found_rad + abs(cost.bias_theta_rad or 0.0) + between + more
