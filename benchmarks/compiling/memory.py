"""What a trial leaves in memory: each chain's answer is kept to the end of its look."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator

from benchmarks.figures import Benchmark, Figure, Options
from microplan.featuresel.selection.race import Race, race
from microplan.featuresel.trials.trial_cache import Known
from microplan.featuresel.trials.trials import prepare
from tests.featuresel.conftest import CASES

CHAIN = ("otsu",)
FEW, MANY = 200, 1200  # trials


def _measure(_options: Options) -> Iterator[Figure]:
    tracemalloc.start()
    each = (_held(MANY) - _held(FEW)) / (MANY - FEW)
    tracemalloc.stop()
    yield Figure(name="compile.trial_bytes", value=each, unit="B")


def _held(trials: int) -> int:
    """Return what one chain's race holds at its end beside pictures, bytes.

    What is kept of images and shapes for any race is not counted.
    """
    held = [_raced(trials)]
    gc.collect()
    most, _ = tracemalloc.get_traced_memory()
    held.clear()
    gc.collect()
    least, _ = tracemalloc.get_traced_memory()
    return most - least


def _raced(trials: int) -> tuple[Race, Known]:
    """Return a race and what it knows but for pictures: they are 64 MiB at most."""
    case, known = CASES["post"](), Known()
    ready = prepare(case, [CHAIN])
    found = race(case, ready, root_seed=1, most=trials, rounds=(), known=known)
    known.pictures.clear()
    if len(found.outcomes) != trials:
        raise RuntimeError(f"{len(found.outcomes)} outcomes of {trials} trials")
    return found, known


BENCHMARK = Benchmark(names=("compile.trial_bytes",), measure=_measure)
