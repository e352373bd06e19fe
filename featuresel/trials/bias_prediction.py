"""The bias of chains through focus, predicted on images without noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.features.factorial_design import interior
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bias import BiasCurve
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import (
    Map,
    PreparedRoutines,
    is_wrong,
    measure_picture,
)

_REACH = 3.0  # sigmas of the focus: trials go no farther
_HEIGHTS = 9  # within that; the bias between two of them is interpolated
_TURN = 1.0  # sigmas of the angle, to both sides


def predict_bias(
    case: LookCase,
    prepared: PreparedRoutines,
    *,
    dz_um: Sequence[float] | None = None,
    poses: int = 4,
    root_seed: int = 0,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Mapping[Chain, BiasCurve]:
    """Return the bias that the renderer predicts for each chain.

    Every chain measures images without noise, with the nominal zoom, light and defocus
    model, at several poses: places within a pixel, and angles of the look's spread.
    What is common to them in the target's frame is the bias; the rest depends on how
    the target lies on the pixels and cannot be taken off.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        Its chains and artifacts.
    dz_um : sequence of float, optional
        Focus heights from nominal, rising; by default 9 within 3 sigma of the look's
        focus spread, or the nominal alone where that is 0.
    poses : int
        How many poses at each height.
    root_seed : int
        Of the poses, which heights and chains share.
    map : callable
        As in `microplan.featuresel.trials.trials.run`; gets one height at a time.

    Returns
    -------
    mapping of Chain to BiasCurve
        Heights at which a pose is not answered rightly are left out; a chain that has
        none left is not there.

    Raises
    ------
    ValueError
        If `poses` is below 1.
    """
    if poses < 1:
        raise ValueError(f"poses must be at least 1, got {poses}")
    heights = default_heights(case) if dz_um is None else tuple(dz_um)
    places = _poses(case, poses, root_seed)
    seen = list(map(partial(_at_height, case, prepared, places), heights))
    found = {}
    for chain in prepared.chains:
        rows = [
            (height, mine)
            for height, outcomes in zip(heights, seen, strict=True)
            if (mine := _right(case, chain, outcomes)) is not None
        ]
        if rows:
            found[chain] = _curve(rows)
    return found


def default_heights(case: LookCase) -> tuple[float, ...]:
    """Return the focus heights at which the bias of a look is predicted."""
    reach = _REACH * case.spread.focus_sigma_um
    if reach == 0:
        return (0.0,)
    return tuple(float(z) for z in np.linspace(-reach, reach, _HEIGHTS))


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


def _at_height(
    case: LookCase, prepared: PreparedRoutines, poses: tuple[Trial, ...], dz_um: float
) -> list[Outcome]:
    """Return what every chain says at one focus height, pose by pose."""
    render = nominal_render(case)
    found: list[Outcome] = []
    for pose in poses:
        picture = render.at_height(
            dz_um, dx_um=pose.dx_um, dy_um=pose.dy_um, theta_rad=pose.dtheta_rad
        )
        found.extend(measure_picture(case, prepared, pose, picture))
    return found


def _right(
    case: LookCase, chain: Chain, outcomes: Sequence[Outcome]
) -> list[Outcome] | None:
    """Return a chain's outcomes of one height if all of them are right."""
    mine = [o for o in outcomes if o.chain == chain]
    if any(o.failure is not None or is_wrong(case, o) for o in mine):
        return None
    return mine


def _curve(rows: Sequence[tuple[float, list[Outcome]]]) -> BiasCurve:
    """Return means and scatter of the errors at each height."""
    places = [_array([o.target_um for o in mine]) for _, mine in rows]
    middles = [errors.mean(axis=0) for errors in places]
    turns = [[o.theta_rad for o in mine] for _, mine in rows]
    known = all(turn is not None for mine in turns for turn in mine)
    return BiasCurve(
        dz_um=tuple(height for height, _ in rows),
        x_um=tuple(float(middle[0]) for middle in middles),
        y_um=tuple(float(middle[1]) for middle in middles),
        theta_rad=tuple(float(_array(mine).mean()) for mine in turns)
        if known
        else None,
        scatter_um=tuple(
            float(np.sqrt(((errors - middle) ** 2).sum(axis=1).mean()))
            for errors, middle in zip(places, middles, strict=True)
        ),
    )


def _array(values: Sequence[object]) -> FloatArray:
    return np.array(values, dtype=np.float64)
