"""The documented list of extreme points: how many fail."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.figures import Benchmark, Figure, Options
from tests.optics.extremes.extreme_points import points


def _measure(_options: Options) -> Iterator[Figure]:
    """Count points that gave nan, infinity, a warning or a wrong value."""
    failed = sum(not point.holds() for point in points())
    yield Figure(name="optics.extremes_failed", value=failed, unit="1")


BENCHMARK = Benchmark(names=("optics.extremes_failed",), measure=_measure)
