"""Signed heights from a pair of images on both sides of focus, against their limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from benchmarks.localisation.information import together
from benchmarks.localisation.scenes import SCENES, Drawn, disturbed, draws, free_names
from benchmarks.localisation.trials import (
    SAME,
    SEED,
    Part,
    Unit,
    dark_to_bright,
    guess,
    relit,
    summed,
    timed,
)
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import limit
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import LookSetting, sensitivities
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.routines.likelihood import defocus_pair

PAIR_UM = 10.0  # on both sides of the height that a pair is taken for
OFFSETS_UM = (-PAIR_UM, PAIR_UM)
WAYS = ("pair", "pair" + SAME)


def measure_pair(unit: Unit) -> Part:
    """Return errors of the height from images `PAIR_UM` on both sides, z um alone.

    The truth is the exact law: "pair" is prepared with the look's own, Hopkins' law,
    "pair_same" with the exact one.
    """
    cv2.setNumThreads(1)
    case, artifact = _ready(unit.scene, unit.condition, unit.way)
    rng = np.random.default_rng([SEED, unit.part])
    shown = [
        draws(case, unit.z_um + offset, unit.trials, SEED, part=unit.part)
        for offset in OFFSETS_UM
    ]
    said: list[Failure | tuple[float, ...]] = []
    settings, spent = [], np.zeros(2)
    for _ in range(unit.trials):
        pair, drawing = timed(lambda: [next(each) for each in shown])
        found, fitting = timed(lambda: _height(case, artifact, pair, rng))  # noqa: B023 - called now
        said.append(found if isinstance(found, Failure) else (found - unit.z_um,))
        settings.append(pair[0].setting)
        spent += drawing, fitting
    known, limiting = timed(lambda: pair_limit_squared(case, unit.z_um, settings))
    return summed(said, (known,), (float(spent[0]), float(spent[1]), limiting))


def pair_limit_squared(
    case: LookCase, z_um: float, settings: Sequence[LookSetting]
) -> float:
    """Return the squared limit of z from both images, the pose and the light shared.

    At the first setting's pose, the mean over the settings' lights.
    """
    exact = replace(case, model="exact")
    even = replace(settings[0], gain=1.0, gradient_x=0.0, gradient_y=0.0)
    seen = [
        sensitivities(exact, replace(even, dz_um=z_um + dz), free_names(case))
        for dz in OFFSETS_UM
    ]
    found = []
    for at in dark_to_bright(settings):
        one, other = (fisher(relit(case, each, at), camera_of(case)) for each in seen)
        found.append(limit(together(one, other))["z"] ** 2)
    return float(np.mean(found))


def _height(
    case: LookCase, artifact: Artifact, pair: Sequence[Drawn], rng: np.random.Generator
) -> float | Failure:
    """Return the height that a pair tells, from a coarse guess with the angle."""
    at = guess(case, pair[0], rng, told=True)
    found = defocus_pair.measure([d.image for d in pair], OFFSETS_UM, artifact, at)
    if isinstance(found, Failure):
        return found
    if found.z_um is None:
        raise TypeError("a pair gives a height")
    return found.z_um


@lru_cache(maxsize=1)
def _ready(scene: str, condition: str, way: str) -> tuple[LookCase, Artifact]:
    """Return a look and the pair's fit that is prepared for it."""
    case = disturbed(SCENES[scene](), condition)
    told = replace(case, model="exact") if way.endswith(SAME) else case
    artifact = defocus_pair.prepare(
        nominal_render(told), told.target, offset_um=PAIR_UM
    )
    if isinstance(artifact, Failure):
        raise ValueError(artifact.message)
    return case, artifact
