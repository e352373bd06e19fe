"""What starting the executor costs, next to importing numpy."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import python_s

REPEATS = 15


def _measure(_options: Options) -> Iterator[Figure]:
    # taken in turns, so that a busy moment meets both
    pairs = [
        (python_s(["-c", "import executor.cli"]), python_s(["-c", "import numpy"]))
        for _ in range(REPEATS)
    ]
    ours, numpy = (min(times) for times in zip(*pairs, strict=True))
    yield Figure(name="executor.import_ratio", value=ours / numpy, unit="1")


BENCHMARK = Benchmark(names=("executor.import_ratio",), measure=_measure)
