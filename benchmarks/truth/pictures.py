"""Pictures of all looks on both roads at equal optics, and at points by waves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.truth.comparison import LookComparison, compared, worst
from benchmarks.truth.compiler_side import Surface, predicted
from benchmarks.truth.examples import DIE, GEAR, TruthExample, plan_of
from benchmarks.truth.judged_looks import judged_looks
from benchmarks.truth.wave_points import WaveErrors, wave_errors

SURFACES = tuple(Surface(wall=w, finish=f) for w in (0.0, 0.6, 1.0) for f in (0.0, 1.0))
PLAIN = SURFACES[0]  # of the points by waves: mirrors are left to rays
POINTS = 21  # a look
EXAMPLES = (GEAR, DIE)
FULL = "full scale"
TOTALS = (
    "truth.worst_look.max_error",
    "truth.worst_look.rms",
    "truth.worst_look.close_share",
    "truth.cell_sampling.max_error",
    "truth.cell_sampling.rms",
    "truth.prediction_median",
    "truth.violations",
    "truth.waves.compiler_max",
    "truth.waves.compiler_rms",
    "truth.waves.cell_max",
    "truth.waves.cell_rms",
    "truth.waves.points",
)
KINDS = ("max_error", "rms", "close_share")
NAMES = (
    *(
        f"truth.{e.name}.{look}.{k}"
        for e in EXAMPLES
        for look in e.looks
        for k in KINDS
    ),
    *TOTALS,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedPicture:
    """One look of one surface, with what the ledger says of it."""

    example: str
    found: LookComparison
    predicted: float  # of full scale; what `truth` can answer to
    waves: WaveErrors | None  # None: not asked for

    @property
    def truth(self) -> float:
        """Return the compiler's largest error, by rays or by waves."""
        by_waves = 0.0 if self.waves is None else self.waves.compiler_max
        return max(self.found.error.max_error, by_waves)


def all_judged(
    plans: Mapping[TruthExample, Path], jobs: int = 1
) -> list[JudgedPicture]:
    """Return all looks of examples' plans, of all surfaces, `jobs` at a time."""
    asked = [
        (example, file, (surface,), POINTS, (look,))
        for example, file in plans.items()
        for surface in SURFACES
        for look in example.looks
    ]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        found = pool.map(_judged_one, *zip(*asked, strict=True))
        return [picture for pictures in found for picture in pictures]


def _judged_one(
    example: TruthExample,
    plan_file: Path,
    surfaces: Sequence[Surface],
    points: int,
    only: Sequence[str],
) -> list[JudgedPicture]:
    """Return what `judged` yields: a pool's process sends no iterator."""
    return list(judged(example, plan_file, surfaces, points, only))


def judged(
    example: TruthExample,
    plan_file: Path,
    surfaces: Sequence[Surface],
    points: int,
    only: Sequence[str] = (),
) -> Iterator[JudgedPicture]:
    """Yield an example's looks, of one surface after the other."""
    for surface in surfaces:
        for look in judged_looks(example.file, plan_file, surface, only):
            asked = points if surface == PLAIN else 0
            yield JudgedPicture(
                example=example.name,
                found=compared(look),
                predicted=predicted(look.trial, by_waves=asked > 0),
                waves=wave_errors(look, asked) if asked else None,
            )


def figures(pictures: Sequence[JudgedPicture]) -> Iterator[Figure]:
    """Yield each look's worst over the surfaces, then the worst of all.

    A prediction is violated where the truth is beyond it by more than the cell's own
    sampling error. Ratios are of looks whose error is more than that.
    """
    for example in EXAMPLES:
        for name in example.looks:
            of_look = [
                p.found.error
                for p in pictures
                if (p.example, p.found.id) == (example.name, name)
            ]
            if of_look:
                most = worst(of_look)
                stem = f"truth.{example.name}.{name}"
                yield _one(f"{stem}.max_error", most.max_error, FULL)
                yield _one(f"{stem}.rms", most.rms, FULL)
                yield _one(f"{stem}.close_share", most.share)
    most, own = (
        worst([getattr(p.found, kind) for p in pictures])
        for kind in ("error", "sampling")
    )
    yield _one("truth.worst_look.max_error", most.max_error, FULL)
    yield _one("truth.worst_look.rms", most.rms, FULL)
    yield _one("truth.worst_look.close_share", most.share)
    yield _one("truth.cell_sampling.max_error", own.max_error, FULL)
    yield _one("truth.cell_sampling.rms", own.rms, FULL)
    ratios = [
        p.predicted / p.truth for p in pictures if p.truth > p.found.sampling.max_error
    ]
    yield _one("truth.prediction_median", float(np.median(ratios)), "predicted / true")
    beyond = [p for p in pictures if p.truth - p.found.sampling.max_error > p.predicted]
    yield _one("truth.violations", len(beyond), f"of {len(pictures)} pictures")
    yield from _by_waves([p.waves for p in pictures if p.waves is not None])


def _by_waves(found: Sequence[WaveErrors]) -> Iterator[Figure]:
    """Yield how far both roads are from waves, at all points of all looks."""
    for side in ("compiler", "cell"):
        errors = np.concatenate([getattr(each, side) for each in found])
        yield _one(f"truth.waves.{side}_max", float(np.abs(errors).max()), FULL)
        yield _one(f"truth.waves.{side}_rms", float(np.sqrt(np.mean(errors**2))), FULL)
    yield _one("truth.waves.points", sum(len(each.cell) for each in found))


def _one(name: str, value: float, unit: str = "1") -> Figure:
    return Figure(name=name, value=value, unit=unit)


def _measure(options: Options) -> Iterator[Figure]:
    with ExitStack() as stack:
        plans = {e: stack.enter_context(plan_of(e, options)) for e in EXAMPLES}
        yield from figures(all_judged(plans, options.jobs))


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
