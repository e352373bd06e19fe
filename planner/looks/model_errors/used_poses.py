"""Poses in which a look's answer is used, as trials for pairs of images."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.featuresel.look.design import Trial, random_design
from microplan.featuresel.look.scenario import LookCase

LEAST = 12  # pairs that a chain must answer, both images of each
SPARE = 4  # more poses, in place of those that are not answered
_RIM_SIGMAS = 2.0  # of the pose, where no step says how far off an answer is used


def used_poses(
    case: LookCase, within_um: float | None, *, count: int, root_seed: int
) -> tuple[Trial, ...]:
    """Return trials at the poses in which a look's answer is used.

    Every other pair of them lies on the rim of what the step hands over, in directions
    that divide it evenly: where an alignment stops, or a verification still agrees.
    The others are random, as the workcell states it: where the first look is. Each pose
    comes with its mirror image about the nominal one, focus and zoom included, so that
    an error that changes its sign with the displacement or the focus has no mean.

    Parameters
    ----------
    case : LookCase
        The look.
    within_um : float, optional
        How far off the nominal pose the step still uses the answer, um. None: it says
        nothing, and two sigma of the pose are taken.
    count : int
        Poses, even.
    root_seed : int
        Root of all seeds.
    """
    if count < 2 or count % 2:
        raise ValueError(f"count must be even and at least 2, got {count}")
    pairs = count // 2
    # what is farther out of focus is seen from another focus stop, nearer to its own
    fresh = replace(case, key=f"{case.key}/used", stated=case.drawn)
    drawn = random_design(fresh, count, root_seed)
    rim_um = within_um or _RIM_SIGMAS * case.drawn.pose_sigma_xy_um
    found = []
    for pair in range(pairs):
        first = _still(drawn[2 * pair])
        if pair % 2 == 0:
            turn, third = divmod(pair // 2, 3)
            way = math.pi * third / 3 + math.pi / 6 * turn
            x, y = rim_um * math.cos(way), rim_um * math.sin(way)
            still = tuple(0.0 for _ in first.turns_rad)
            first = replace(first, dx_um=x, dy_um=y, turns_rad=still)
        first = replace(first, index=2 * pair, model=case.model)
        second = replace(_mirrored(first), index=2 * pair + 1,
                         seed=drawn[2 * pair + 1].seed)  # fmt: skip
        found += [first, second]
    return tuple(found)


def _still(trial: Trial) -> Trial:
    """Return a trial in which the target alone moves.

    What hides it is displaced against it all the same.
    """
    x, y = trial.occluder_um
    return replace(
        trial, dx_um=trial.dx_um - x, dy_um=trial.dy_um - y, occluder_um=(0.0, 0.0),
        together_um=(0.0, 0.0),
    )  # fmt: skip


def _mirrored(trial: Trial) -> Trial:
    """Return a trial with everything the other way: places, turns, focus and zoom."""
    return replace(
        trial,
        dx_um=-trial.dx_um,
        dy_um=-trial.dy_um,
        dz_um=-trial.dz_um,
        magnification=2 - trial.magnification,
        dtheta_rad=-trial.dtheta_rad,
        turns_rad=tuple(-turn for turn in trial.turns_rad),
    )
