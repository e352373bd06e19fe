"""Chances of an insertion against draws, and their tails against mpmath.

`fit.max_error` is the worst of CASES insertions: how far P is from the share of SAMPLES
drawn insertions that go in, in standard errors, floored at one draw; one run in twelve
has more than 3.2 by chance. `fit.mean_square_error` is their mean square: 1 +- .18. A
third of the cases have errors of one direction that are up to a million
times the others, or none at all. `fit.tails_max_relative_error` compares Rice's law,
for chances of a miss down to 1e-133, with mpmath. `fit.ms_per_chance` is one chance of
the cases that lean (no round covariance), the dear ones; its rival are the draws.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable

import mpmath  # type: ignore[import-untyped]  # has no stubs
import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    RoundFit,
    miss_probability,
)
from microplan.schemas.plan import BudgetRow

CASES = 60
SAMPLES = 1_000_000
SEED = 41
NONE = Residual(sigma_um=0.0, within_um=0.0)
# sigma, bias in um for a radius of 3 um: misses of 1e-133, 1e-41, 1e-8, .3 and nearly 1
TAILS = ((0.1212, 0.0), (0.2, 0.3), (0.5, 0.2), (2.0, 0.5), (0.5, 6.0))


def insertions(count: int, seed: int) -> list[Insertion]:
    """Return insertions whose errors differ by orders of magnitude."""
    rng = np.random.default_rng(seed)
    return [_insertion(rng, kind=index % 3) for index in range(count)]


def _insertion(rng: np.random.Generator, kind: int) -> Insertion:
    """Return one: round (0), leaning (1) or of extreme terms (2)."""
    sizes = rng.uniform(0.05, 1.2, 3)
    if kind == 2:
        sizes *= np.array([1.0, 10.0 ** rng.uniform(-6, 0), rng.integers(0, 2)])
    angle = None if kind == 0 else float(rng.uniform(0, math.pi))
    rows = [
        BudgetRow(term=f"term {i}", sigma_um=float(size), source="drawn")
        for i, size in enumerate(sizes[1:])
    ]
    rows.append(
        BudgetRow(
            term="along", sigma_um=float(sizes[0]), source="drawn", along_rad=angle
        )
    )
    left = Residual(sigma_um=float(rng.uniform(0.2, 1.5)), within_um=1.5)
    return Insertion(
        fit=RoundFit(
            hole_um=25.0,
            shaft_um=25.0 - float(rng.uniform(1.0, 4.0)),
            hole_tolerance_um=float(rng.choice([0.0, 0.3])),
            shaft_tolerance_um=float(rng.choice([0.0, 0.5])),
        ),
        residual=left if rng.random() < 0.7 else NONE,
        blind=tuple(rows),
        offset_um=float(rng.choice([0.0, 0.7])),
    )


def share_drawn(job: Insertion, rng: np.random.Generator) -> float:
    """Return the share of SAMPLES drawn insertions that go in."""
    error = np.zeros((SAMPLES, 2))
    residual = job.residual
    if residual.sigma_um > 0:
        most = -math.expm1(-((residual.within_um / residual.sigma_um) ** 2) / 2)
        radius = np.sqrt(-2 * np.log1p(-most * rng.random(SAMPLES)))
        angle = rng.uniform(0, 2 * math.pi, SAMPLES)
        error += residual.sigma_um * (radius * [np.cos(angle), np.sin(angle)]).T
    error[:, 0] += job.offset_um
    for row in job.blind:
        size = row.sigma_um or 0.0
        if row.along_rad is None:
            error += rng.normal(0, size, (SAMPLES, 2))
        else:
            way = np.array([math.cos(row.along_rad), math.sin(row.along_rad)])
            error += rng.normal(0, size, (SAMPLES, 1)) * way
    fit = job.fit
    room = fit.capture_um + rng.uniform(-1, 1, SAMPLES) * fit.hole_tolerance_um
    room += rng.uniform(-1, 1, SAMPLES) * fit.shaft_tolerance_um
    return float((np.hypot(error[:, 0], error[:, 1]) < room).mean())


def errors_of(jobs: Iterable[Insertion], rng: np.random.Generator) -> list[float]:
    """Return the differences from draws, in standard errors."""
    errors = []
    for job in jobs:
        chance = 1 - job.miss
        spread = math.sqrt(chance * (1 - chance) / SAMPLES)
        errors.append(abs(chance - share_drawn(job, rng)) / max(spread, 1 / SAMPLES))
    return errors


def worst_tail() -> float:
    """Return the largest relative difference from mpmath, of a miss and of a hit."""
    fit = RoundFit(
        hole_um=25.0, shaft_um=22.0, hole_tolerance_um=0.0, shaft_tolerance_um=0.0
    )
    errors = []
    for sigma_um, bias_um in TAILS:
        found = miss_probability(fit, NONE, sigma_um, bias_um)
        exact = _rice(fit.capture_um / sigma_um, bias_um / sigma_um)
        errors.append(abs(float(found / exact - 1)))
    return max(errors)


def _rice(radius: float, offset: float) -> float:
    """Return Rice's tail by its density, 30 digits."""
    with mpmath.workdps(30):
        b = mpmath.mpf(offset)

        def density(r: mpmath.mpf) -> mpmath.mpf:
            bessel = mpmath.besseli(0, r * b) * mpmath.exp(-r * b)
            return r * mpmath.exp(-((r - b) ** 2) / 2) * bessel

        steps = [0, *(2.0**k for k in range(-8, 5))]  # exp(-25 r) at first
        tail: float = float(mpmath.quad(density, [radius + step for step in steps]))
        return tail


def measure(options: Options) -> Iterable[Figure]:  # noqa: ARG001 - runs of a plan
    """Yield the figures of the chances."""
    jobs = insertions(CASES, SEED)
    rng = np.random.default_rng(SEED + 1)
    errors = errors_of(jobs, rng)
    yield Figure(name="fit.max_error", value=max(errors), unit="1")
    square = sum(error**2 for error in errors) / CASES
    yield Figure(name="fit.mean_square_error", value=square, unit="1")
    tail = worst_tail()
    yield Figure(name="fit.tails_max_relative_error", value=tail, unit="1")
    leaning = insertions(CASES, SEED + 2)[1::3]
    started = time.perf_counter()
    for job in leaning:
        assert 0 <= job.miss <= 1
    took = time.perf_counter() - started
    drawn = time.perf_counter()
    share_drawn(leaning[0], rng)
    rival = time.perf_counter() - drawn
    yield Figure(
        name="fit.ms_per_chance", value=1e3 * took / len(leaning), unit="ms",
        rival=1e3 * rival,
    )  # fmt: skip


BENCHMARK = Benchmark(
    names=(
        "fit.max_error",
        "fit.mean_square_error",
        "fit.tails_max_relative_error",
        "fit.ms_per_chance",
    ),
    measure=measure,
)
