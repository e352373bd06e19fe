"""All benchmarks, in the order in which they run."""

from __future__ import annotations

from benchmarks import (
    coherence,
    error_maps,
    example,
    extremes,
    imports,
    law_outlines,
    layers,
    polarity,
    rendering,
    runs,
    selection,
    selector,
    shading,
    vectors,
)
from benchmarks.figures import Benchmark

BENCHMARKS: tuple[Benchmark, ...] = (
    vectors.BENCHMARK,
    extremes.BENCHMARK,
    error_maps.BENCHMARK,
    law_outlines.BENCHMARK,
    rendering.BENCHMARK,
    selector.BENCHMARK,
    layers.BENCHMARK,
    shading.BENCHMARK,
    coherence.BENCHMARK,
    polarity.BENCHMARK,
    selection.BENCHMARK,
    imports.BENCHMARK,
    example.BENCHMARK,
    runs.BENCHMARK,
)
