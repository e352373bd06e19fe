"""How far what is not known of the lens moves a chain's answers in pictures."""

from __future__ import annotations

import math

import numpy as np

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.planner.looks.model_errors.answer_shift import AnswerShift
from microplan.planner.looks.model_errors.better_models import (
    BetterModel,
    better_models,
)
from microplan.planner.looks.model_errors.halo_ends import HALO
from microplan.planner.looks.model_errors.image_pairs import image_pairs
from microplan.planner.looks.model_errors.model_cost import effect_difference
from microplan.planner.looks.model_errors.used_poses import LEAST, SPARE, used_poses
from microplan.planner.looks.model_errors.wavefront_ends import UNKNOWN
from microplan.planner.task.workcell import Optics

_UNIFORM = math.sqrt(3.0)  # half-widths of an interval a standard deviation


def lens_trueness_um(
    case: LookCase, prepared: PreparedRoutines, lens: Optics, root_seed: int
) -> float | None:
    """Return how far the lens moves answers, the worse axis, one standard deviation.

    By pairs of images with and without what the workcell leaves open of wavefront and
    halo, as plans are charged.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        One chain.
    lens : Optics
        What the workcell says of the objective.
    root_seed : int
        Root of all seeds.

    Returns
    -------
    float or None
        um; None where too few of the images with it are answered.
    """
    effects = (UNKNOWN, HALO) if lens.halo is None else (UNKNOWN,)
    every = better_models(case, effects, (), lens.wavefront)
    models = tuple(model for model in every if _changes(model))
    poses = used_poses(case, None, count=LEAST + SPARE, root_seed=root_seed)
    answers = image_pairs(case, prepared, models, poses)
    squares = 0.0
    for number, model in enumerate(models):
        own = [answer for answer in answers if answer.model == number]
        found = effect_difference(model, own)
        if isinstance(found, str):
            return None
        squares += _square_um2(found.place)
    return math.sqrt(squares)


def _square_um2(moved: AnswerShift) -> float:
    """Return the mean square of what a lens moves answers by, the worse axis, um^2."""
    most_um = float((np.abs(moved.mean) + moved.half_width).max())
    return (most_um / _UNIFORM) ** 2


def _changes(model: BetterModel) -> bool:
    """Return whether a model has an end that is not what it is better than."""
    return any(case != model.against for end in model.ends for _, case in end.cases)
