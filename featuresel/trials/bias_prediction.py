"""The bias of chains at the look's own focus, predicted on images without noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from microplan.featuresel.features.factorial_design import interior
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import (
    Map,
    PreparedRoutines,
    is_wrong,
    measure_picture,
)

_TURN = 1.0  # sigmas of the angle, to both sides

PoseBias = tuple[float, float, float]  # x um, y um, theta rad, the target's frame


def predict_bias(
    case: LookCase,
    prepared: PreparedRoutines,
    *,
    poses: int,
    root_seed: int = 0,
    power: float = 1.0,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Mapping[Chain, PoseBias]:
    """Return the bias that the renderer predicts for each chain.

    Every chain measures images without noise, with the nominal focus, zoom, light and
    defocus model, at several poses: places within a pixel, and angles of the look's
    spread. What is common to them in the target's frame is the bias; the rest depends
    on how the target lies on the pixels.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        Its chains and artifacts.
    poses : int
        How many poses.
    root_seed : int
        Of the poses, which chains share.
    power : float
        Of the light, that the camera's counts follow, while chains take them for light.
    map : callable
        As in `microplan.featuresel.trials.trials.run`; gets one pose at a time.

    Returns
    -------
    mapping of Chain to (x um, y um, theta rad)
        The angle's is 0 where none is given. A chain that does not answer rightly at
        every pose is not there.

    Raises
    ------
    ValueError
        If `poses` is below 1.
    """
    if poses < 1:
        raise ValueError(f"poses must be at least 1, got {poses}")
    at_pose = partial(_at_pose, case, prepared, power)
    seen = [o for found in map(at_pose, _poses(case, poses, root_seed)) for o in found]
    found = {}
    for chain in prepared.chains:
        mine = [o for o in seen if o.chain == chain]
        if not any(o.failure is not None or is_wrong(case, o) for o in mine):
            found[chain] = _mean(mine)
    return found


def _poses(case: LookCase, count: int, root_seed: int) -> tuple[Trial, ...]:
    """Return trials that differ from nominal in place within a pixel and in angle."""
    points = interior("design", f"{case.key}/bias", root_seed, count)[:count, :3]
    width_rad = math.pi if case.theta_any else _TURN * case.spread.pose_sigma_theta_rad
    pixel_um = case.microscope.um_per_px
    return tuple(
        Trial(
            index=k,
            dx_um=float(x - 0.5) * pixel_um,
            dy_um=float(y - 0.5) * pixel_um,
            dtheta_rad=float(2 * turn - 1) * width_rad,
            model=case.model,
            seed=(0,),  # there is no noise
        )
        for k, (x, y, turn) in enumerate(points)
    )


def _at_pose(
    case: LookCase, prepared: PreparedRoutines, power: float, pose: Trial
) -> tuple[Outcome, ...]:
    """Return what every chain says at one pose."""
    picture = nominal_render(case)(
        dx_um=pose.dx_um, dy_um=pose.dy_um, theta_rad=pose.dtheta_rad
    )
    if power != 1:
        picture = np.maximum(picture, 0.0) ** power
    return measure_picture(case, prepared, pose, picture)


def _mean(outcomes: Sequence[Outcome]) -> PoseBias:
    """Return the mean error of right answers."""
    errors = np.array([o.target_um for o in outcomes], dtype=np.float64)
    x_um, y_um = errors.mean(axis=0)
    turns = [o.theta_rad for o in outcomes if o.theta_rad is not None]
    theta_rad = np.mean(turns) if len(turns) == len(outcomes) else 0.0
    return (float(x_um), float(y_um), float(theta_rad))
