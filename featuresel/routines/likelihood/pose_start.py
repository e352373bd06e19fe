"""Starts of a pose fit: focus, zoom, angle, which of a pattern's equal rotations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.featuresel.routines.contract import Failure, Guess
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.comparison import (
    ImageComparison,
    at,
    try_each,
)
from microplan.featuresel.routines.likelihood.pose_fit import PoseFit

# A mark that is seen has a share of 1, one that is hidden of 0, each with a deviation
# of 1 / sqrt(told): at three quarters four deviations keep both apart.
_SEEN = 0.75
_CONTRAST = 256.0
_ENOUGH = 200  # cells: of the gear they tell 5000 and more up to 25 um out of focus


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """How much of what breaks a pattern's symmetry shows at T rotations."""

    share: FloatArray  # (T,) 1: all of it, 0: the pattern goes on; -inf: out of view
    contrast: FloatArray  # (T,) chi squared between the two


def marks(
    job: ImageComparison, found: PoseFit, turns: FloatArray, cells: IntArray
) -> Marks:
    """Return how much of a pattern's mark an image shows at some rotations.

    Parameters
    ----------
    job : Job
        The images.
    found : PoseFit
        What fits best, at any of the rotations.
    turns : (T,) float array
        Rotations from the template, rad.
    cells : (N,) int array
        Of the template: where the mark is.

    Notes
    -----
    A matched filter: what the image has of the difference between the template and
    itself half way round, where the pattern goes on, weighted by the noise.
    """
    cells = cells[:: max(1, len(cells) // _ENOUGH)]
    pose, displaced = found.pose, turns + farthest_rad(job.symmetry)
    shown, contrast = np.zeros(len(turns)), np.zeros(len(turns))
    for view in job.views:
        here = at(pose, view)
        seen = job.looks.turned(here, turns, cells, job.shape)
        plain = job.looks.values(here, displaced, seen.columns, seen.rows)
        marked, even = (
            job.lit(here, light, seen.columns, seen.rows, found.light)
            for light in (seen.value, plain)
        )
        value = view.image[seen.rows, seen.columns]
        weight = (marked - even) * seen.inside / job.camera.variance(marked)
        shown += (weight * (value - even)).sum(axis=1)
        contrast += (weight * (marked - even)).sum(axis=1)
    share = np.where(contrast > 0, shown / np.maximum(contrast, 1e-12), -math.inf)
    return Marks(share=share, contrast=contrast)


def is_marked(found: Marks) -> bool:
    """Return whether the first of `equal_turns`, and none more, shows the mark.

    Half a period off it shows nearly as much of one that is wide.
    """
    whole = found.share[[0, *range(3, len(found.share))]]
    best = bool(whole[0] >= whole.max())
    return best and bool(found.contrast[0] > _CONTRAST and whole[0] > _SEEN)


def farthest_rad(symmetry: int) -> float:
    """Return the rotation by whole periods that leads farthest away, rad."""
    return 2 * math.pi / symmetry * round(symmetry / 2)


def equal_turns(turn_rad: float, symmetry: int) -> FloatArray:
    """Return (N,) equal rotations of a pattern, half a period off too, rad."""
    steps = np.array([0.0, -0.5, 0.5, *range(1, symmetry)])
    return np.asarray(turn_rad + steps * 2 * math.pi / symmetry)


def other_turns(turn_rad: float, symmetry: float, range_rad: float) -> FloatArray:
    """Return the (N,) other equal rotations of a pattern within a range, rad."""
    turns = turn_rad + 2 * math.pi / symmetry * np.arange(1, int(symmetry))
    turns = np.remainder(turns + math.pi, 2 * math.pi) - math.pi
    within: FloatArray = turns[np.abs(turns) <= range_rad]
    return within


_DEPTHS = (0.1, 0.35, 0.6, 0.85)  # of the reach in focus, where fits start
_DEEP = 2.5  # steps of the planes between focus heights, once the position is known
_ZOOM_PX = 1.5  # that the rim moves by between zooms where fits start
_TURN_PX = 2.5  # that the rim moves by between turns where fits start
_MOST_TURNS = 64  # of them, at every focus height: more take too long


def start_pose(
    job: ImageComparison, p: Mapping[str, float], guess: Guess
) -> ImagePose | Failure:
    """Return where the fit starts: focus and angle that fit best, if not known."""
    turns = _turns(job, p, guess)
    if isinstance(turns, Failure):
        return turns
    depths = [guess.z_um or 0.0]
    if guess.z_um is None and p["focus_sigma_um"] > 0:
        depths = _depths(job)
    pose = ImagePose(
        column=guess.column,
        row=guess.row,
        turn_rad=turns[len(turns) // 2],
        z_um=depths[0],
        zoom=guess.zoom or 1.0,
    )
    zooms = [pose.zoom] if guess.zoom is not None else _zooms(job, p)
    if len(zooms) > 1:  # focus and zoom first: all at once would be too many
        pose = try_each(job, pose, turns=[pose.turn_rad], depths=depths, zooms=zooms)
        depths, zooms = [pose.z_um], [pose.zoom]
    if len(depths) * len(turns) == 1:
        return pose
    return try_each(job, pose, turns=turns, depths=depths, zooms=zooms)


def refocused(job: ImageComparison, pose: ImagePose) -> ImagePose:
    """Return a pose with the focus that fits best of all within reach.

    At a position that is off, more blur fits better: `start_pose` may be far out of
    focus. Fitted at that focus the position is right, and there depths differ.
    """
    reach_um = job.looks.reach_um - max(abs(view.dz_um) for view in job.views)
    count = math.ceil(2 * reach_um / (_DEEP * job.looks.step_um))
    depths = [reach_um * ((2 * k + 1) / count - 1) for k in range(count)]
    return try_each(job, pose, turns=[pose.turn_rad], depths=depths, zooms=[pose.zoom])


def _zooms(job: ImageComparison, p: Mapping[str, float]) -> list[float]:
    """Return zooms to start at, within two standard deviations of nominal."""
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    reach = 2 * p["zoom_sigma"]
    count = math.ceil(2 * reach * rim_px / _ZOOM_PX)
    return [1 + reach * ((2 * k + 1) / count - 1) for k in range(count)] or [1.0]


def _turns(
    job: ImageComparison, p: Mapping[str, float], guess: Guess
) -> list[float] | Failure:
    """Return rotations to start at: a measured one, or all about an assumed one."""
    if not p["turns"]:
        return [0.0]
    middle = 0.0
    if guess.theta_rad is not None:
        middle = math.remainder(guess.theta_rad - p["theta_rad"], 2 * math.pi)
        if not guess.theta_assumed:
            return [middle]
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    reach = min(p["range_rad"], math.pi / p["symmetry"])
    count = math.ceil(2 * reach * rim_px / _TURN_PX)
    if count > _MOST_TURNS:
        return Failure("no_angle", "the fit needs an angle to start at")
    return [middle + reach * ((2 * k + 1) / count - 1) for k in range(count)]


def _depths(job: ImageComparison) -> list[float]:
    """Return focus heights to start at, on both sides where they look different."""
    farthest = max(abs(view.dz_um) for view in job.views)
    ahead = [share * (job.looks.reach_um - farthest) for share in _DEPTHS]
    return ahead if job.squared else [*ahead, *(-z for z in ahead)]
