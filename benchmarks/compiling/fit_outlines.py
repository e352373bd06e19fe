"""Chances of fits by outlines against draws.

`fit.outline_max_error` is the worst of PAIRS random pegs and holes: how far P (in the
piece of the free region that holds the planned pose, and in all pieces) is from the
share of SAMPLES draws, in standard errors; one run in 130 has more than 4 by chance.
`fit.outline_rare` counts pairs whose P is outside .05 to .98. `fit.outline_ms` is one P
once its slices are known, `fit.outline_first_ms` with its slices.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from benchmarks.compiling.outline_pairs import Pair, draw, draw_pair
from benchmarks.compiling.outline_shapes import FAMILIES
from benchmarks.figures import Benchmark, Figure, Options
from microplan.planner.budget.probability.outline_probability import Seating, seating

PAIRS = 60
SAMPLES = 100_000
SEED = 61
COMMON = (0.05, 0.98)


def pairs(count: int, seed: int) -> list[Pair]:
    """Return pairs of all families in turn."""
    rng = np.random.default_rng(seed)
    return [draw_pair(FAMILIES[k % len(FAMILIES)], rng) for k in range(count)]


def error_of(pair: Pair, found: Seating, count: int, rng: np.random.Generator) -> float:
    """Return the larger difference from draws, in standard errors of those."""
    drawn = draw(pair, count, rng)
    inside = found.seated + found.elsewhere
    return max(
        abs(found.seated - drawn.seated) / max(drawn.seated_error, 1 / count),
        abs(inside - drawn.inside) / max(drawn.inside_error, 1 / count),
    )


def measure(options: Options) -> Iterable[Figure]:  # noqa: ARG001 - runs of a plan
    """Yield the figures of the fits."""
    rng = np.random.default_rng(SEED + 1)
    errors: list[float] = []
    first: list[float] = []
    again: list[float] = []
    rare = 0
    for pair in pairs(PAIRS, SEED):
        for times in (first, again):
            started = time.perf_counter()
            found = seating(pair.fit, pair.error)
            times.append(time.perf_counter() - started)
        errors.append(error_of(pair, found, SAMPLES, rng))
        rare += not COMMON[0] < found.seated + found.elsewhere < COMMON[1]
    yield Figure(name="fit.outline_max_error", value=max(errors), unit="1")
    yield Figure(name="fit.outline_rare", value=float(rare), unit="1")
    yield Figure(name="fit.outline_ms", value=1e3 * float(np.median(again)), unit="ms")
    yield Figure(
        name="fit.outline_first_ms", value=1e3 * float(np.median(first)), unit="ms"
    )


BENCHMARK = Benchmark(
    names=(
        "fit.outline_max_error",
        "fit.outline_rare",
        "fit.outline_ms",
        "fit.outline_first_ms",
    ),
    measure=measure,
)
