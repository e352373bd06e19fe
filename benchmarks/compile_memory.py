"""What a trial leaves in memory: each chain's answer is kept to the end of its look."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator

from benchmarks.figures import Benchmark, Figure, Options
from featuresel.known import Known
from featuresel.race import race
from featuresel.trials import prepare
from tests.featuresel.conftest import CASES

CHAIN = ("otsu",)
# trials; the first fill what is kept of images and of points, whatever their number
FEW, MANY = 1100, 1700


def _measure(_options: Options) -> Iterator[Figure]:
    tracemalloc.start()
    _held(FEW)
    (few, few_top), (many, many_top) = _held(FEW), _held(MANY)
    tracemalloc.stop()
    more = MANY - FEW
    yield Figure(name="compile.trial_bytes", value=(many - few) / more, unit="B")
    top = (many_top - few_top) / more
    yield Figure(name="compile.trial_top_bytes", value=top, unit="B")


def _held(trials: int) -> tuple[int, int]:
    """Return what one chain's race holds at its end beside pictures, bytes.

    And what it held at most, pictures included.
    """
    case, known = CASES["post"](), Known()
    ready = prepare(case, [CHAIN])
    gc.collect()
    tracemalloc.reset_peak()
    before, _ = tracemalloc.get_traced_memory()
    found = race(case, ready, root_seed=1, most=trials, rounds=(), known=known)
    known.pictures.clear()  # 64 MiB at most, however many trials
    gc.collect()
    after, top = tracemalloc.get_traced_memory()
    if len(found.outcomes) != trials:
        raise RuntimeError(f"{len(found.outcomes)} outcomes of {trials} trials")
    return after - before, top - before


BENCHMARK = Benchmark(
    names=("compile.trial_bytes", "compile.trial_top_bytes"), measure=_measure
)
