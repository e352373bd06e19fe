"""How near routines come to the Cramer-Rao limit: the likelihood fit, and all others.

Truth is another blur law than the estimator's (`benchmarks.localisation_scenes`); bias
counts in the rms; the limit is of the same free numbers, in the same light, behind the
same fingers. `python -m benchmarks.localisation_table` prints every routine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import fft

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.localisation_scenes import (
    CONDITIONS,
    SCENES,
    Drawn,
    disturbed,
    draws,
    free_names,
    gear,
)
from benchmarks.timing import cpu_s
from featuresel.case import LookCase
from featuresel.crlb import camera_of, fisher
from featuresel.information import limit
from featuresel.nominal import nominal_render
from featuresel.routines import Artifact, Failure, Guess, Measurement, load
from featuresel.routines.chain import measure_chain
from featuresel.sensitivity import Setting, sensitivities

FloatArray = npt.NDArray[np.float64]

HEIGHTS_UM = (0.0, 5.0, 10.0, 25.0)
TRIALS = 1500
SEED = 7
AXES = ("x", "y", "theta")
OFF_PX = 1.5  # how far off a coarse routine may be, that the fit starts from
OFF_RAD = 0.02  # and its angle, but for patterns, where it is not told any
_LIMITS = 6  # settings, at least, whose limits are averaged
_TIMED = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """What was found at one scene, condition and focus."""

    scene: str
    condition: str
    z_um: float
    trials: int
    failed: int
    rms: tuple[float, ...]  # x, y um and theta rad; nan where not given
    limit: tuple[float, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        """Return rms over limit of x, y and theta."""
        return tuple(r / m for r, m in zip(self.rms, self.limit, strict=True))


def limits(case: LookCase, settings: Sequence[Setting]) -> tuple[float, ...]:
    """Return the limit of x, y and theta, its mean square over some settings."""
    exact, names = replace(case, model="exact"), free_names(case)
    found = []
    for setting in settings:
        seen = sensitivities(exact, setting, names)
        known = limit(fisher(seen, camera_of(exact)))
        found.append([known.get(axis, math.nan) for axis in AXES])
    mean: FloatArray = np.sqrt(np.mean(np.square(found), axis=0))
    return tuple(float(v) for v in mean)


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


def prepared(case: LookCase, chain: Sequence[str]) -> list[tuple[str, Artifact]]:
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


def guess(case: LookCase, drawn: Drawn, rng: np.random.Generator) -> Guess:
    """Return what a coarse routine might say: off by up to `OFF_PX`, any angle."""
    s, k = drawn.setting, case.microscope.px_per_um
    off, along = OFF_PX * math.sqrt(rng.random()), 2 * math.pi * rng.random()
    x, y = s.zoom * (case.x_um + s.dx_um), s.zoom * (case.y_um + s.dy_um)
    column, row = case.frame.to_pixel(x, y)
    theta = case.theta_rad + s.dtheta_rad + OFF_RAD * rng.uniform(-1, 1)
    return Guess(
        column=column + off * math.cos(along),
        row=row + off * math.sin(along),
        theta_rad=None if case.target.symmetry > 1 else theta,
    )


def measure_point(scene: str, condition: str, z_um: float, trials: int) -> Point:
    """Return what the likelihood fit finds from a coarse guess."""
    case = disturbed(SCENES[scene](), condition)
    stages = prepared(case, ("likelihood",))
    shown, rng = draws(case, z_um, trials, SEED), np.random.default_rng(SEED)
    found = [measure_chain(d.image, stages, guess(case, d, rng)) for d in shown]
    off = [
        errors(case, d, f)
        for d, f in zip(shown, found, strict=True)
        if isinstance(f, Measurement)
    ]
    rms = np.sqrt(np.mean(np.square(off or [(math.inf,) * 3]), axis=0))
    every = max(1, len(shown) // _LIMITS)
    return Point(
        scene=scene,
        condition=condition,
        z_um=z_um,
        trials=len(shown),
        failed=len(shown) - len(off),
        rms=tuple(float(v) for v in rms),
        limit=limits(case, [d.setting for d in shown[::every]][:_LIMITS]),
    )


def points() -> list[tuple[str, str, float]]:
    """Return all scenes, conditions and heights that are measured."""
    return [
        (scene, condition, z)
        for scene in SCENES
        for condition in CONDITIONS
        if not (scene == "fingers" and condition == "fingers")
        for z in HEIGHTS_UM
    ]
