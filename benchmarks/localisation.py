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
from featuresel.routines import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    defocus_pair,
    load,
)
from featuresel.routines.chain import measure_chain
from featuresel.sensitivity import Setting, sensitivities

FloatArray = npt.NDArray[np.float64]

HEIGHTS_UM = (0.0, 5.0, 10.0, 25.0)
TRIALS = 1500
SEED = 7
AXES = ("x", "y", "theta")
PAIR_UM = 10.0  # on both sides of the height that a pair is taken for
DEPTHS_UM = (0.0, 5.0, 10.0)
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
    s = drawn.setting
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


def measure_depth(z_um: float, trials: int) -> float:
    """Return rms over limit of the height from images `PAIR_UM` on both sides.

    The estimator knows the law here: with another one the height alone is off, by what
    the two laws differ in.
    """
    case = replace(disturbed(gear(), "plain"), model="exact")
    k, rng = case.microscope.px_per_um, np.random.default_rng(SEED)
    artifact = defocus_pair.prepare(
        nominal_render(case), case.target, offset_um=PAIR_UM
    )
    if isinstance(artifact, Failure):
        raise ValueError(artifact.message)
    offsets = (-PAIR_UM, PAIR_UM)
    pairs = [draws(case, z_um + dz, trials, SEED) for dz in offsets]
    found = []
    for pair in zip(*pairs, strict=True):
        s = pair[0].setting
        at = Guess(
            column=case.target.column + s.dx_um * k + rng.uniform(-1, 1),
            row=case.target.row - s.dy_um * k + rng.uniform(-1, 1),
            theta_rad=case.theta_rad + s.dtheta_rad,
        )
        fit = defocus_pair.measure([d.image for d in pair], offsets, artifact, at)
        if isinstance(fit, Measurement) and fit.z_um is not None:
            found.append(fit.z_um - z_um)
    known = _joint_limit(case, z_um, offsets)
    return math.sqrt(float(np.mean(np.square(found)))) / known


def _joint_limit(case: LookCase, z_um: float, offsets: Sequence[float]) -> float:
    """Return the limit of z from images at some offsets, all else shared."""
    told = [
        fisher(
            sensitivities(case, Setting(dz_um=z_um + dz), free_names(case)),
            camera_of(case),
        )
        for dz in offsets
    ]
    return limit(told[0] + told[1])["z"]


def times_ms() -> tuple[float, float, float]:
    """Return CPU time of a fix from the last one, of one from nothing, and a floor."""
    case = gear()
    stages = prepared(case, ("otsu", "likelihood"))
    shown = draws(case, 2.0, _TIMED, SEED)
    cold, warm = [], []
    for drawn in shown:
        first, taken = _timed(drawn.image, stages, start(case))
        cold.append(taken)
        last = Guess(
            column=first.column + 0.3,
            row=first.row - 0.3,
            theta_rad=first.theta_rad,
            z_um=first.z_um,
            zoom=first.zoom,
        )
        warm.append(_timed(drawn.image, stages[1:], last)[1])
    image = np.random.default_rng(1).random((480, 640))
    pair = [
        cpu_s(lambda: fft.irfft2(fft.rfft2(image), s=image.shape)) for _ in range(40)
    ]
    return 1e3 * float(np.median(warm)), 1e3 * float(np.median(cold)), 1e3 * min(pair)


def _timed(
    image: FloatArray, stages: Sequence[tuple[str, Artifact]], at: Guess
) -> tuple[Measurement, float]:
    """Return a fix and its CPU time, s."""
    kept: list[Measurement | Failure] = []
    taken = cpu_s(lambda: kept.append(measure_chain(image, stages, at)))
    if isinstance(kept[0], Failure):
        raise TypeError(kept[0].message)
    return kept[0], taken


def start(case: LookCase) -> Guess:
    """Return the nominal place, and the angle where it is known."""
    theta = None if case.theta_any else case.target.theta_rad
    return Guess(column=case.target.column, row=case.target.row, theta_rad=theta)


def _measure_each(point: tuple[str, str, float]) -> Point:
    return measure_point(*point, TRIALS)


def _figures(point: Point) -> Iterator[Figure]:
    """Return the figures of one point; those of the plain gear have short names."""
    for name, ratio in zip(_names(point.scene, point.condition, point.z_um),
                           point.ratios, strict=False):  # fmt: skip
        if not math.isnan(ratio):
            yield Figure(name=name, value=ratio, unit="1")
    yield Figure(
        name=_names(point.scene, point.condition, point.z_um)[3],
        value=point.failed / point.trials,
        unit="1",
    )


def _names(scene: str, condition: str, z_um: float) -> list[str]:
    """Return the names of a point's figures."""
    words = ["localisation", scene, f"z{z_um:g}"]
    words += [] if condition == "plain" else [condition]
    ends = ("ratio_x", "ratio_y", "ratio_theta", "failed")
    return [".".join((*words, end)) for end in ends]


def _all_names() -> tuple[str, ...]:
    """Return all figures' names in the order of `_measure`."""
    found = []
    for scene, condition, z in points():
        names = _names(scene, condition, z)
        found += names[:2] + ([] if scene == "shaft" else names[2:3]) + names[3:]
    found += [f"localisation.gear.z{z:g}.ratio_z" for z in DEPTHS_UM]
    return (*found, "localisation.gear.warm_ms", "localisation.gear.cold_ms")


def _measure(options: Options) -> Iterator[Figure]:
    """Measure all points, then depth and times."""
    warm, cold, floor = times_ms()
    with ProcessPoolExecutor(options.jobs) as pool:
        for point in pool.map(_measure_each, points()):
            yield from _figures(point)
        depths = pool.map(partial(measure_depth, trials=TRIALS), DEPTHS_UM)
        for z, ratio in zip(DEPTHS_UM, depths, strict=True):
            yield Figure(
                name=f"localisation.gear.z{z:g}.ratio_z", value=ratio, unit="1"
            )
    yield Figure(name="localisation.gear.warm_ms", value=warm, unit="ms", floor=floor)
    yield Figure(name="localisation.gear.cold_ms", value=cold, unit="ms", floor=floor)


BENCHMARK = Benchmark(names=_all_names(), measure=_measure)
