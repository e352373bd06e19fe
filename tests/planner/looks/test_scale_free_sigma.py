"""The spread of a look less the zoom's scale, by answers that are made up."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import random_design
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.repeatability import Repeated
from microplan.featuresel.trials.score import ChainScore, score_chain
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_record import sigma_without_scale_um
from tests.planner.looks.conftest import CHAIN

COUNT, SEED = 24, 3


def answered(tried: Evaluation, noise_um: np.ndarray, scale: float = 1.0) -> Evaluation:
    """Return answers that err by a trial's zoom, as far as `scale` says, and noise."""
    place = np.array([tried.case.x_um, tried.case.y_um])
    outcomes = []
    for trial, more in zip(
        random_design(tried.case, COUNT, SEED), noise_um, strict=True
    ):
        x, y = scale * (trial.magnification - 1) * place + more
        outcomes.append(
            Outcome(
                chain=CHAIN,
                trial=trial.index,
                failure=None,
                world_um=(x, y),
                target_um=(x, y),
                theta_rad=0.0,
                score=1.0,
                spread_um=0.01,
            )
        )
    return with_outcomes(tried, Outcomes.of(outcomes))


def with_outcomes(tried: Evaluation, outcomes: Outcomes) -> Evaluation:
    return replace(tried, comparison=replace(tried.comparison, outcomes=outcomes))


def scored(tried: Evaluation) -> ChainScore:
    return score_chain(tried.case, CHAIN, tried.comparison.outcomes, 1.0)


def without_scale_um(tried: Evaluation) -> float:
    outcomes = tried.comparison.outcomes
    repeated = Repeated(outcomes=outcomes, scores=(scored(tried),))
    return sigma_without_scale_um(tried, repeated, CHAIN, SEED)


def test_what_the_scale_does_is_taken_off_to_the_last_bit(tried: Evaluation) -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.007, (COUNT, 2))
    found = answered(tried, noise)
    sigma_um = without_scale_um(found)
    assert sigma_um == pytest.approx(noise.std(axis=0, ddof=1).max(), rel=1e-12)
    # one number scales both axes: the farther one has most of it
    case, whole_um = tried.case, scored(found).sigma_um
    assert whole_um is not None
    scale_um = case.drawn.magnification_sigma * max(abs(case.x_um), abs(case.y_um))
    # 4 standard errors of a sigma from so many
    assert whole_um == pytest.approx(
        math.hypot(scale_um, 0.007), rel=4 / math.sqrt(2 * COUNT)
    )


def test_where_the_scale_does_next_to_nothing_the_spread_is_the_trials(
    tried: Evaluation,
) -> None:
    near = replace(tried, case=replace(tried.case, x_um=0.0, y_um=0.5))
    found = answered(near, np.random.default_rng(1).normal(0.0, 0.007, (COUNT, 2)))
    assert without_scale_um(found) == math.inf


def test_at_any_angle_and_of_few_answers_it_is_not_known(tried: Evaluation) -> None:
    found = answered(tried, np.random.default_rng(1).normal(0.0, 0.007, (COUNT, 2)))
    turned = replace(found, case=replace(found.case, theta_any=True))
    assert without_scale_um(turned) == math.inf
    few = with_outcomes(found, found.comparison.outcomes[:2])
    assert without_scale_um(few) == math.inf
