"""Signed depth from images on both sides of focus, fitted as one.

One image does not tell on which side of focus a face lies, and near focus hardly how
far off. A pair, or a stack, taken at known distances tells both: position, angle, zoom
and light are shared, and only the focus differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Target,
)
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.comparison import (
    DefocusedImage,
    ImageComparison,
)
from microplan.featuresel.routines.likelihood.fit_problem import prepare_job, read_job
from microplan.featuresel.routines.likelihood.likelihood import answer, fitted
from microplan.featuresel.routines.likelihood.pose_fit import PoseFit, fit_pose
from microplan.featuresel.routines.likelihood.pose_start import refocused, start_pose
from microplan.featuresel.routines.picture import refused


def prepare(
    model: LookModel, target: Target, *, offset_um: float
) -> Artifact | Failure:
    """Return what `measure` needs for images up to `offset_um` from the face."""
    return prepare_job(model, target, offset_um=offset_um)


def measure(
    images: Sequence[FloatArray],
    offsets_um: Sequence[float],
    artifact: Artifact,
    guess: Guess,
) -> Measurement | Failure:
    """Return the pose that all images have in common, and its signed focus.

    Parameters
    ----------
    images : sequence of (rows, columns) arrays
        At least two, 0..1 of full scale.
    offsets_um : sequence of float
        Focus of each image against the height that is to be found.
    artifact : Artifact
        By `prepare` of this module.
    guess : Guess
        As for `microplan.featuresel.routines.likelihood.likelihood.measure`.

    Returns
    -------
    Measurement or Failure
        `z_um` is the focus from nominal, signed: positive above.

    Raises
    ------
    ValueError
        If there are fewer than two images, or not as many offsets.
    """
    if len(images) < 2 or len(images) != len(offsets_um):
        raise ValueError("need two images or more, and as many offsets")
    unfit = next((u for u in map(refused, images) if u is not None), None)
    if unfit is not None:
        return unfit
    views = tuple(
        DefocusedImage(image=image, dz_um=offset)
        for image, offset in zip(images, offsets_um, strict=True)
    )
    job, p = read_job(views, artifact), artifact.parameters
    start = start_pose(job, p, guess)
    if isinstance(start, Failure):
        return start
    if guess.z_um is None:
        start = _at_focus(job, start)
    found = fitted(job.held, start)
    if isinstance(found, PoseFit) and job.front is not None:
        found = fitted(job, found.pose)
    if isinstance(found, Failure):
        return found
    # images at one offset are as one: they need not tell a side
    is_signed = found.is_signed or max(offsets_um) > min(offsets_um)
    return answer(replace(found, is_signed=is_signed), p, guess)


def _at_focus(job: ImageComparison, start: ImagePose) -> ImagePose:
    """Return where a fit starts, once the position is right and determines the focus.

    A pair has minima far from its focus, where one image alone fits.
    """
    level = replace(job.held, free=replace(job.held.free, z_sigma_um=0.0))
    placed = fit_pose(level, start)
    return refocused(job, placed.pose if isinstance(placed, PoseFit) else start)
