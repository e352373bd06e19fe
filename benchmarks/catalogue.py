"""All benchmarks, in the order in which they run."""

from __future__ import annotations

from benchmarks import (
    coherence,
    compiling,
    costs,
    error_maps,
    example,
    extremes,
    feature_sets,
    fit,
    focus,
    imports,
    law_outlines,
    layers,
    localisation,
    placing,
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
    costs.BENCHMARK,
    feature_sets.BENCHMARK,
    focus.BENCHMARK,
    fit.BENCHMARK,
    localisation.BENCHMARK,
    imports.BENCHMARK,
    example.BENCHMARK,
    compiling.BENCHMARK,
    runs.BENCHMARK,
    placing.BENCHMARK,
)
