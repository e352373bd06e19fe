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
FEW, MANY = 400, 1000  # trials; the first fill what is kept of images of any look


def _measure(_options: Options) -> Iterator[Figure]:
    tracemalloc.start()
    _held(FEW)
    each = (_held(MANY) - _held(FEW)) / (MANY - FEW)
    tracemalloc.stop()
    yield Figure(name="compile.trial_bytes", value=each, unit="B")


def _held(trials: int) -> int:
    """Return what one chain's race holds at its end beside pictures, bytes."""
    case, known = CASES["post"](), Known()
    ready = prepare(case, [CHAIN])
    gc.collect()
    before, _ = tracemalloc.get_traced_memory()
    found = race(case, ready, root_seed=1, most=trials, rounds=(), known=known)
    known.pictures.clear()  # 64 MiB at most, however many trials
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    if len(found.outcomes) != trials:
        raise RuntimeError(f"{len(found.outcomes)} outcomes of {trials} trials")
    return after - before


BENCHMARK = Benchmark(names=("compile.trial_bytes",), measure=_measure)
