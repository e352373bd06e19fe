"""Some trials of a routine at one scene, condition and height, and their limit.

A `Unit` is what one process measures in one go and what is recorded; nothing but the
unit decides its images, so units are measured in any order and by any number of
processes. Truth is another blur law than the one that routines are prepared with, but
for ways that end in `SAME`: what is left there is the routine's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TypeVar

import cv2
import numpy as np

from benchmarks.localisation.scenes import SCENES, Drawn, disturbed, draws, free_names
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import limit
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import (
    POSE,
    LookSetting,
    Sensitivities,
    sensitivities,
)
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.registry import load
from microplan.optics.render.layer_blending import light_up
from microplan.optics.render.scene import Illumination

T = TypeVar("T")

SEED = 7
AXES = ("x", "y", "theta")
# what a look may ask of a part of 100 um under 1 um pixels, and that at its rim
TOLERANCE_UM, TOLERANCE_RAD = 0.5, 0.01
WRONG = 2.0  # tolerances, as in the trials
OFF_PX = 1.5  # how far off a coarse routine may be, that the fit starts from
OFF_RAD = 0.02  # and its angle, but for patterns, where it is not told any
LOOKED_AT = ("gear_close",)  # but close up, as a look from afar went before
NEAR_PX = 0.3  # what the last answer of a servo is off by, that `one_step` starts from
NEAR_UM = 0.5  # and its focus
SAME = "_same"  # ends a way whose routine is prepared with the truth's blur law
_RIM_UM = 50.0  # of the gear: what NEAR_PX there is as an angle and a zoom
_LIGHTS = 8  # of a unit's trials, from dark to bright, that its limit is averaged over


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """Which trials: `part` numbers those of one point, each with its own poses."""

    way: str  # a routine, and `SAME` if it knows the true law; pairs, see depth
    scene: str
    condition: str
    z_um: float
    part: int
    trials: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What a unit's trials gave; sums are over right answers, x, y um and theta rad."""

    trials: int
    failed: int
    silent: int  # answered, but more than two tolerances off
    sums: tuple[float, ...]
    squares: tuple[float, ...]
    limit_squared: tuple[float, ...]  # mean over the trials' lights, at one pose
    codes: tuple[str, ...]  # of failures
    cpu_s: tuple[float, float, float]  # drawing, measuring, the limit


def axes_of(case: LookCase) -> tuple[str, ...]:
    """Return what of x, y and theta a look tells."""
    return AXES[:2] if case.target.kind == "circle" else AXES


def measure_single(unit: Unit) -> Part:
    """Return what a routine finds in single images: the fit from a coarse guess."""
    cv2.setNumThreads(1)
    case, stages = _ready(unit.scene, unit.condition, unit.way)
    rng = np.random.default_rng([SEED, unit.part])
    told = partial(guess, told=unit.scene in LOOKED_AT)
    begin = near if unit.way == "one_step" else told
    shown = draws(case, unit.z_um, unit.trials, SEED, part=unit.part)
    said, lights, spent = [], [], np.zeros(2)
    for _ in range(unit.trials):
        drawn, drawing = timed(lambda: next(shown))
        at = begin(case, drawn, rng)
        found, fitting = timed(lambda: measure_chain(drawn.image, stages, at))  # noqa: B023 - called now
        said.append(found if isinstance(found, Failure) else errors(case, drawn, found))
        lights.append(drawn.setting)
        spent += drawing, fitting
    known, limiting = timed(lambda: limit_squared(case, lights))
    count = len(axes_of(case))
    return summed(said, known[:count], (float(spent[0]), float(spent[1]), limiting))


def summed(
    said: Sequence[Failure | tuple[float, ...]],
    limit_squared: tuple[float, ...],
    spent_s: tuple[float, float, float],
) -> Part:
    """Return failures and errors as sums over the right answers."""
    count = len(limit_squared)
    off = [each[:count] for each in said if not isinstance(each, Failure)]
    good = np.array([each for each in off if is_right(each)]).reshape(-1, count)
    return Part(
        trials=len(said),
        failed=len(said) - len(off),
        silent=len(off) - len(good),
        sums=tuple(good.sum(axis=0).tolist()),
        squares=tuple((good**2).sum(axis=0).tolist()),
        limit_squared=limit_squared,
        codes=tuple(each.code for each in said if isinstance(each, Failure)),
        cpu_s=spent_s,
    )


def is_right(off: Sequence[float]) -> bool:
    """Return whether x, y and theta are within two tolerances; a lone z always is."""
    if len(off) < 2:
        return True
    turned = off[2] if len(off) > 2 else 0.0
    return (
        math.hypot(off[0], off[1]) <= WRONG * TOLERANCE_UM
        and not abs(turned)
        > WRONG * TOLERANCE_RAD  # a nan is no answer, not a wrong one
    )


def limit_squared(case: LookCase, settings: Sequence[LookSetting]) -> tuple[float, ...]:
    """Return the squared limit of x, y and theta, the mean over the settings' lights.

    At the pose of the first setting: a unit's poses hardly differ in their limits, its
    lights do.
    """
    exact = replace(case, model="exact")
    even = replace(settings[0], gain=1.0, gradient_x=0.0, gradient_y=0.0)
    seen = sensitivities(exact, even, free_names(case))
    found = []
    for setting in dark_to_bright(settings):
        known = limit(fisher(relit(case, seen, setting), camera_of(case)))
        found.append([known.get(axis, math.nan) for axis in AXES])
    return tuple(np.mean(np.square(found), axis=0).tolist())


def dark_to_bright(settings: Sequence[LookSetting]) -> list[LookSetting]:
    """Return the middles of as many equal shares of the settings, ranked by light."""
    ranked = sorted(settings, key=lambda s: s.gain)
    count = min(_LIGHTS, len(ranked))
    return [ranked[int((k + 0.5) * len(ranked) / count)] for k in range(count)]


def relit(case: LookCase, seen: Sensitivities, setting: LookSetting) -> Sensitivities:
    """Return slopes seen in even light of gain 1 in a setting's light.

    Those to the light stay as they are: in another light they are other sums of the
    same, and what a pose's limit is does not depend on how the light is counted.
    """
    light: FloatArray = np.ones_like(seen.mean)
    light_up(
        light,
        case.microscope,
        case.window,
        Illumination(
            gain=setting.gain,
            gradient_x=setting.gradient_x,
            gradient_y=setting.gradient_y,
        ),
    )
    posed = np.array([name in POSE for name in seen.names])[:, None, None]
    return replace(
        seen,
        mean=seen.mean * light,
        slopes=np.where(posed, seen.slopes * light, seen.slopes),
        errors=seen.errors * light,
    )


def errors(
    case: LookCase, drawn: Drawn, found: Measurement
) -> tuple[float, float, float]:
    """Return x, y um and theta rad, measured - true; nan where theta is not given."""
    s = drawn.setting
    x, y = case.frame.to_world(found.column, found.row)
    true = s.zoom * (case.x_um + s.dx_um), s.zoom * (case.y_um + s.dy_um)
    turned = math.nan
    if found.theta_rad is not None:
        turned = math.remainder(
            found.theta_rad - case.theta_rad - s.dtheta_rad, 2 * math.pi
        )
    return x - true[0], y - true[1], turned


def guess(
    case: LookCase, drawn: Drawn, rng: np.random.Generator, *, told: bool = False
) -> Guess:
    """Return what a coarse routine might say: off by up to `OFF_PX` and `OFF_RAD`.

    Of a pattern no angle, unless it is `told`.
    """
    s = drawn.setting
    column, row = _nearby(case, s, OFF_PX, rng)
    theta = case.theta_rad + s.dtheta_rad + OFF_RAD * rng.uniform(-1, 1)
    return Guess(
        column=column,
        row=row,
        theta_rad=theta if told or case.target.symmetry == 1 else None,
    )


def near(case: LookCase, drawn: Drawn, rng: np.random.Generator) -> Guess:
    """Return what a servo knows before its last cycle: all of it, and nearly right."""
    s = drawn.setting
    column, row = _nearby(case, s, NEAR_PX, rng)
    turn = NEAR_PX / case.microscope.px_per_um / _RIM_UM
    zoomed = turn * rng.uniform(-1, 1) if case.spread.magnification_sigma else 0.0
    return Guess(
        column=column,
        row=row,
        theta_rad=case.theta_rad + s.dtheta_rad + turn * rng.uniform(-1, 1),
        z_um=s.dz_um + NEAR_UM * rng.uniform(-1, 1),
        zoom=s.zoom + zoomed,
    )


def _nearby(
    case: LookCase, s: LookSetting, far_px: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Return a column and row evenly distributed about the true ones."""
    off, along = far_px * math.sqrt(rng.random()), 2 * math.pi * rng.random()
    x, y = s.zoom * (case.x_um + s.dx_um), s.zoom * (case.y_um + s.dy_um)
    column, row = case.frame.to_pixel(x, y)
    return column + off * math.cos(along), row + off * math.sin(along)


def prepared(case: LookCase, chain: Iterable[str]) -> list[tuple[str, Artifact]]:
    """Return a chain's routines with their artifacts.

    Raises
    ------
    ValueError
        If one cannot be prepared.
    """
    render, stages = nominal_render(case), []
    for name in chain:
        artifact = load(name).prepare(render, case.target)
        if isinstance(artifact, Failure):
            raise ValueError(f"{name}: {artifact.message}")
        stages.append((name, artifact))
    return stages


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return what a call returns, and its CPU time, s."""
    kept: list[T] = []
    taken = cpu_s(lambda: kept.append(work()))
    return kept[0], taken


@lru_cache(maxsize=1)  # units of one scene and condition follow each other
def _ready(
    scene: str, condition: str, way: str
) -> tuple[LookCase, list[tuple[str, Artifact]]]:
    """Return a look and the routine that is prepared for it."""
    case = disturbed(SCENES[scene](), condition)
    told = replace(case, model="exact") if way.endswith(SAME) else case
    return case, prepared(told, (way.removesuffix(SAME),))
