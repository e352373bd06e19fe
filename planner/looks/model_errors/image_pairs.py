"""Chains on pairs of images: one as trials have it, one by a better model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import (
    Map,
    PreparedRoutines,
    is_wrong,
    measure_picture,
    period_rad,
)
from microplan.optics.lens.sensor import linear
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.pair_pictures import (
    PairPictures,
    PosePictures,
    common_part,
    pose_pictures,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedAnswer:
    """What a chain said of a pair of images."""

    chain: Chain
    model: int  # which better model
    end: int  # which of its ends
    trial: int
    at_um: tuple[float, float, float]  # displacement of the target, and of the focus
    angle_rad: float  # of the target's frame in the world
    # the better image's answer less the other's, target's frame; None: not both answer
    off_um: tuple[float, float] | None
    turn_rad: float | None  # None: no angle is measured
    # errors of the usual image's answer, along the same axes; None as above
    error_um: tuple[float, float] | None
    error_rad: float | None
    failure: str  # of the better image where the other one is answered; "": none
    score: float | None  # of the better image, where both answer
    spread_um: float | None  # that the chain states of itself then
    image_error: float  # largest difference of the images, share of full scale


def image_pairs(
    case: LookCase,
    prepared: PreparedRoutines,
    models: tuple[BetterModel, ...],
    trials: tuple[Trial, ...],
    *,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    known: PairPictures | None = None,
) -> tuple[PairedAnswer, ...]:
    """Return what chains say of pairs of images at some poses, pose by pose.

    Both images of a pair have the same pose, focus, light and noise. A better image is
    made of the part of the region that shows the target.

    Parameters
    ----------
    case : LookCase
        The look as trials image it.
    prepared : PreparedRoutines
        Its chains and artifacts.
    models : tuple of BetterModel
        The other sides of the pairs.
    trials : tuple of Trial
        Poses.
    map : callable
        As in `microplan.featuresel.trials.trials.run`.
    known : PairPictures, optional
        Pictures of the same look, models and trials; takes those that are made.
    """
    kept = known or PairPictures()
    work = partial(_at_pose, case, prepared, models, common_part(case, trials))
    poses = [(trial, kept.made.get(trial.index)) for trial in trials]
    found: list[PairedAnswer] = []
    for trial, (answers, fresh) in zip(trials, map(work, poses), strict=True):
        found += answers
        if fresh is not None and known is not None:
            kept.keep(trial.index, fresh)
    return tuple(found)


def _at_pose(
    case: LookCase,
    prepared: PreparedRoutines,
    models: tuple[BetterModel, ...],
    part: tuple[slice, slice],
    pose: tuple[Trial, PosePictures | None],
) -> tuple[list[PairedAnswer], PosePictures | None]:
    """Return what chains say of all pairs at one pose, and pictures that are new."""
    trial, known = pose
    made = known or pose_pictures(case, models, part, trial)
    usual = linear(made.counts, case.sensor)
    before = measure_picture(case, prepared, trial, usual)
    found = []
    for each in made.better:
        changed = usual.copy()
        changed[made.part] = linear(each.counts, case.sensor)
        after = measure_picture(case, prepared, trial, changed)
        where = (each.model, each.end)
        found += [
            _answer(case, where, trial, pair, each.image_error)
            for pair in zip(before, after, strict=True)
        ]
    return found, made if known is None else None


def _answer(
    case: LookCase,
    where: tuple[int, int],
    trial: Trial,
    pair: Sequence[Outcome],
    image_error: float,
) -> PairedAnswer:
    """Return the difference of two answers at a model's end in a trial."""
    before, after = pair
    model, end = where
    off, turn, failure, score, spread_um = None, None, "", None, None
    error, error_rad = None, None
    one, other = before.target_um, after.target_um
    if one is not None and not is_wrong(case, before):
        if other is None or is_wrong(case, after):
            failure = after.failure or "wrong"
        else:
            off = (other[0] - one[0], other[1] - one[1])
            turn = _turned(case, before, after)
            error, error_rad = one, before.theta_rad
            score, spread_um = after.score, after.spread_um
    return PairedAnswer(
        chain=before.chain, model=model, end=end, trial=trial.index,
        at_um=(trial.dx_um, trial.dy_um, trial.dz_um), off_um=off,
        angle_rad=case.theta_rad + trial.dtheta_rad,
        turn_rad=turn, error_um=error, error_rad=error_rad,
        failure=failure, score=score, spread_um=spread_um,
        image_error=image_error,
    )  # fmt: skip


def _turned(case: LookCase, before: Outcome, after: Outcome) -> float | None:
    """Return the difference of two angles, rad, None where one is not measured."""
    if before.theta_rad is None or after.theta_rad is None:
        return None
    return math.remainder(after.theta_rad - before.theta_rad, period_rad(case))
