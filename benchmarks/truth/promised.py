"""Sigma and bias that a plan promises of looks, as far as the cell has their causes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.schemas.plan import Look, ModelCost, Plan, Repeatability
from microplan.schemas.plan.measures import MOST_SPARED

# Rows of the ledger that neither the trials nor the cell image: what they cost is
# promised for, and nothing on the cell's pictures could meet it.
UNSEEN = ("vectorial field", "spectrum of the light")


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What a look's errors are compared with, along the axes of the target's frame."""

    trials: int  # random ones that sigma comes from
    sigma_um: tuple[float, float]
    half_width_um: tuple[float, float]  # of the bias, all its parts of one sign
    unseen_bias_um: tuple[float, float]  # of what is taken off: that of `UNSEEN`


def promised(look: Look) -> Promise:
    """Return what a plan promises of a look's answers on the cell's pictures.

    Sigma is that of the trials with what better images change, by axis: the plan
    states the larger axis' for both, which is no standard deviation of the other.

    Raises
    ------
    ValueError
        If the plan is of a version that keeps no random trials.
    """
    known = look.repeatability
    if known is None:
        raise ValueError(f"{look.id} has no random trials: compile the plan again")
    bias, half, sigma = _unseen(look)
    return Promise(
        trials=known.trials,
        sigma_um=_pair(_charged_um(known, look.model_cost, sigma)),
        half_width_um=_pair(np.maximum(_half_width(look, known) - half, 0.0)),
        unseen_bias_um=_pair(bias),
    )


def _unseen(look: Look) -> FloatArray:
    """Return bias, half-width and sigma of what the cell does not show, (3, 2) um.

    A look's bias and half-width are the sums of its rows' (`ModelCost`), of its own
    target alone; its sigma is that sum at most, so that less of it is left than may be.
    """
    costs = [row.cost for row in look.effects if row.effect in UNSEEN]
    rows = [
        (each.bias_um, each.half_width_um, each.sigma_um)
        for each in costs
        if each is not None and look.together is None
    ]
    found: FloatArray = np.array(rows, dtype=np.float64).reshape(-1, 3, 2).sum(axis=0)
    return found


def _charged_um(
    known: Repeatability, cost: ModelCost | None, unseen_um: FloatArray
) -> FloatArray:
    """Return sigma with what better images change, but for the unseen, (2,) um."""
    sigma_um, true_um = np.array(known.sigma_um), np.array(known.trueness_um or 0.0)
    if cost is None:
        return sigma_um
    more_um = np.maximum(np.array(cost.sigma_um) - unseen_um, 0.0)
    most_um2 = MOST_SPARED * np.maximum(sigma_um**2 - true_um**2, 0.0)
    less_um2 = np.minimum(np.square(cost.spared_um), most_um2)
    found: FloatArray = np.sqrt(sigma_um**2 + more_um**2 - less_um2)
    return found


def _half_width(look: Look, known: Repeatability) -> FloatArray:
    """Return how far off all parts of a look's bias are, (2,) um, of one sign."""
    cost = look.model_cost
    more = (0.0, 0.0) if cost is None else cost.half_width_um
    found: FloatArray = np.add(known.half_width_um, more)
    return found


def _pair(values: FloatArray) -> tuple[float, float]:
    """Return (2,) um as two numbers."""
    x, y = (float(value) for value in values)
    return (x, y)


def angles_before(plan: Plan) -> Mapping[str, float]:
    """Return sigma of the angle, rad, at looks whose target's was measured before.

    By the look's id; a run takes biases off at that angle, as trials do at the true
    one.
    """
    known: dict[str, float] = {}
    found: dict[str, float] = {}
    for look in (look for step in plan.steps for look in step.looks):
        owner = look.target.partition(".")[0]
        if owner in known:
            found[look.id] = known[owner]
        if look.sigma_theta_rad is not None:
            known[owner] = look.sigma_theta_rad
    return found
