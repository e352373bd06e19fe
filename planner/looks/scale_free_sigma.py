"""The spread of a look without what an unknown scale of the zoom makes of its place."""

from __future__ import annotations

import math

import numpy as np

from microplan.featuresel.look.design import design
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import is_wrong
from microplan.planner.looks.evaluation import Evaluation

# Beyond this the target's frame is not the world's, in which a scale acts.
SMALL_RAD = 0.2
NOTHING = 0.1  # of sigma: half a percent of its square
LEAST = 3  # answers from which a spread is worth having


def sigma_without_scale_um(
    tried: Evaluation, chosen: ChainScore, root_seed: int
) -> float:
    """Return one sigma of a chain's place, the larger axis, less the trials' scale.

    A trial at the zoom ratio r shows a target at p from the axis at r p. Two looks at
    one zoom share that error, so that a budget of both has it once, by the distance
    between their places; here it is taken off, trial by trial.

    Returns
    -------
    float
        Infinite where it is not known, at any angle or of too few answers, and where
        the scale makes next to nothing of the place.
    """
    case, place_um = tried.case, np.array([tried.case.x_um, tried.case.y_um])
    scale_um = float(np.hypot(*place_um)) * case.spread.magnification_sigma
    if chosen.sigma_um is None or scale_um < NOTHING * chosen.sigma_um:
        return math.inf
    if case.theta_any or case.spread.pose_sigma_theta_rad > SMALL_RAD:
        return math.inf
    right = tried.outcomes.by(chosen.chain).only(
        lambda o: o.world_um is not None and not is_wrong(case, o)
    )
    if len(right) < LEAST:
        return math.inf
    trials = design(case, 1 + max(o.trial for o in right), root_seed)
    zoom = np.array([trials[o.trial].magnification for o in right]) - 1
    errors_um = np.array([o.world_um for o in right]) - zoom[:, None] * place_um
    return float(errors_um.std(axis=0, ddof=1).max())
