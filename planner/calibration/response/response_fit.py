"""Response of a camera from pictures of one still scene in several lights.

A pixel's light is e t: its own exposure, unknown, times the stated reading. Its level
is black + (white - black) f(e t). The response f, from 0 to 1, is a power or a table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.planner.calibration.count_levels import count_levels
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_covariance,
)
from microplan.planner.calibration.response.light_levels import (
    LightLevels,
    LightStep,
    chosen_levels,
)
from microplan.planner.calibration.response.response_curves import (
    POWERS,
    LightCurve,
    cleared,
    common_errors,
    log_of,
    log_weights,
    power_curve,
    row_sigmas,
    rows_of,
    table_curve,
)

FEWEST_LIGHTS = 5  # black, power and two of a correction, and one to judge them
_WIDEST = 1.8  # times: over less light black level and power look alike
_RISE = 4.0  # counts that half of the pixels rise by, or light does not reach them
_BETTER = 0.9  # of the power's error at held-out levels that a table must reach

_WHAT = "response"
_TAKE = (
    f"one still scene of dark and bright areas in {FEWEST_LIGHTS + 5} different lights "
    "from darkness nearly to saturation, eight frames each"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseFit:
    """What levels in several lights tell of the response, up to a factor of the light.

    The factor makes the share 1 at `white`. Where levels were not `seen` up to there
    the curve goes on straight, and that error of the factor is in no deviation.
    """

    kind: str  # "power" or "table"
    gamma: BlockEstimate  # of the power, also where a table is better
    # count without light; below 0: darkness is cut off. Of a power, where the power
    # meets no light. No deviation for a table that no dark frame ends.
    black: BlockEstimate
    white: float  # count at share 1
    white_is_seen: bool  # counts pile up there; else the stated, or full scale
    rows: tuple[tuple[float, float], ...]  # light and level, 0..1; () of a power
    row_sigmas: tuple[float | None, ...]  # standard deviations of rows' levels
    seen: tuple[float, float]  # levels 0..1 that were measured: rows beyond continue
    held_out_power: float  # rms error at levels of a light left out, counts
    held_out_table: float | None  # None: no table that rises could be fitted
    lights: int
    pixels: int


def fit_response(
    steps: Sequence[LightStep], top: int, stated_white: float | None = None
) -> ResponseFit | Refused:
    """Return the response, and how surely it is known.

    Standard deviations are those of leaving out one light at a time: errors of readings
    and of the lamp are common to all pixels of a step.

    Parameters
    ----------
    steps : sequence of LightStep
        In any order; readings of 0 are frames without light.
    top : int
        The full scale, counts.
    stated_white : float, optional
        Count of saturation, where no counts pile up.
    """
    why = _unfit(steps)
    if why:
        return Refused(what=_WHAT, why=why, take=_TAKE)
    codes = np.sum([step.scene.codes for step in steps], axis=0)
    saturated = count_levels(codes, top).white_level
    full = float(top if stated_white is None else stated_white)
    white = full if saturated is None else float(saturated)
    levels = chosen_levels(steps, white)
    if levels is None:
        why = f"no pixel is clear of cut-off counts in {FEWEST_LIGHTS} lights"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    lit = np.where(levels.weights > 0, levels.means, np.nan)
    if float(np.median(np.nanmax(lit, axis=1) - np.nanmin(lit, axis=1))) < _RISE:
        why = "counts do not rise with the light readings"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    levels = cleared(levels, power_curve(levels), white)
    used = levels.lights[(levels.weights > 0).any(axis=0) & (levels.lights > 0)]
    count = np.unique(used).size
    if count < FEWEST_LIGHTS or used.max() < _WIDEST * used.min():
        why = f"{count} lights leave levels that are not cut off"
        if count:
            why += f", from {used.min():.2g} to {used.max():.2g} of the brightest"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    power = power_curve(levels)
    if not POWERS[0] * 1.01 < power.gamma < POWERS[1] * 0.99:
        why = "counts do not follow the light readings"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    return _judged(levels, power, white, seen=saturated is not None)


def _unfit(steps: Sequence[LightStep]) -> str:
    """Return why steps cannot be used, "" if they can."""
    readings = [step.light for step in steps]
    if not all(math.isfinite(light) and light >= 0 for light in readings):
        return "light readings must be 0 or more"
    count = len({light for light in readings if light > 0})
    if count < FEWEST_LIGHTS:
        return f"{count} different lights, {FEWEST_LIGHTS} are needed"
    if len({step.scene.total.shape for step in steps}) > 1:
        return "pictures are not of one size"
    return ""


def _judged(
    levels: LightLevels, power: LightCurve, white: float, *, seen: bool
) -> ResponseFit:
    """Return the better of power and table at lights that were left out."""
    lit = np.flatnonzero((levels.weights > 0).any(axis=0))
    some = [levels.without(int(k)) for k in lit]
    powers = [power_curve(each, power) for each in some]
    tables = [table_curve(each, one) for each, one in zip(some, powers, strict=True)]
    table = table_curve(levels, power)
    rows = rows_of(table, white)
    rms, wins = _held_out_rms(levels, lit, powers, tables)
    bent = rows is not None and wins and rms[1] < _BETTER * rms[0]
    without = [
        np.array([a.gamma, (b if bent else a).black])
        for a, b in zip(powers, tables, strict=True)
    ]
    gamma, darkness = _numbers(levels, power, table.black if bent else None, without)
    taken = rows if bent and rows is not None else ()
    inside = levels.means[levels.weights > 0]
    black = darkness.value
    span = white - black
    dark = bool((levels.weights[:, levels.lights == 0] > 0).any())
    return ResponseFit(
        kind="table" if bent else "power",
        gamma=gamma,
        black=replace(darkness, sigma=None) if bent and not dark else darkness,
        white=white,
        white_is_seen=seen,
        rows=taken,
        row_sigmas=row_sigmas(taken, tables, white),
        seen=(float(inside.min() - black) / span, float(inside.max() - black) / span),
        held_out_power=rms[0],
        held_out_table=None if rows is None else rms[1],
        lights=len(lit),
        pixels=int((levels.weights > 0).any(axis=1).sum()),
    )


def _numbers(
    levels: LightLevels,
    power: LightCurve,
    black: float | None,
    without: Sequence[FloatArray],
) -> tuple[BlockEstimate, BlockEstimate]:
    """Return gamma and black; `without`: (2,) of each light left out.

    `black` is that of a table. Of few lights the jackknife's variance is small or large
    by chance: variances are the mean of it and of that of readings that err alike,
    whichever is larger, since a choice of the larger is too large on the whole.
    """
    values = np.array([power.gamma, power.black if black is None else black])
    covariance = jackknife_covariance(without)
    if covariance is not None:
        own = np.maximum(np.diag(covariance), 1e-300)
        up = np.sqrt((1.0 + common_errors(levels, power) / own) / 2)
        covariance = covariance * np.outer(up, up)
    found = VectorEstimate(
        values=values,
        covariance=covariance,
        method="fit to levels in several lights, lights left out one by one",
        blocks=len(without),
    )
    return found.one(0), found.one(1)


def _held_out_rms(
    levels: LightLevels,
    lit: IntArray,
    powers: Sequence[LightCurve],
    tables: Sequence[LightCurve],
) -> tuple[tuple[float, float], bool]:
    """Return the rms errors of both at the lights left out; whether tables win most."""
    errors = np.array(
        [
            [_held_out(levels, levels.without(k), k, curve) for curve in (power, table)]
            for k, power, table in zip(lit.tolist(), powers, tables, strict=True)
        ]
    )
    errors = errors[np.isfinite(errors).all(axis=1)]
    if not errors.size:
        return (math.nan, math.nan), False
    power, table = np.sqrt(np.mean(errors**2, axis=0)).tolist()
    return (power, table), bool(np.mean(errors[:, 1] < errors[:, 0]) > 0.5)


def _held_out(
    levels: LightLevels, others: LightLevels, light: int, curve: LightCurve
) -> float:
    """Return the rms error of a light's levels by a curve of the others, counts.

    Of levels among those of the others; nan if there are none.
    """
    weights = log_weights(others, curve) ** 2
    norm = weights.sum(axis=1)
    use = (norm > 0) & (levels.weights[:, light] > 0)
    if levels.lights[light] == 0 or not use.any():
        return math.nan
    log_lights = curve.log_light(levels.means) - log_of(levels.lights)
    own = (weights * log_lights).sum(axis=1)[use] / norm[use]
    trained = levels.means[weights > 0]
    grid = np.linspace(trained.min(), trained.max(), 2000)
    rising = np.maximum.accumulate(curve.log_light(grid))
    wanted = own + log_of(levels.lights)[light]
    inside = (wanted > rising[0]) & (wanted < rising[-1])
    if not inside.any():
        return math.nan
    off = np.interp(wanted, rising, grid) - levels.means[use, light]
    return float(np.sqrt(np.mean(off[inside] ** 2)))
