"""All benchmarks, in the order in which they run."""

from __future__ import annotations

from benchmarks import house
from benchmarks.compiling import (
    cluster,
    cores,
    earlier_commits,
    fit,
    fit_outlines,
    imports,
    keyed,
    machines,
    memory,
    stages,
    times,
)
from benchmarks.defocus import error_maps, law_outlines
from benchmarks.executing import (
    control,
    crashes,
    drivers,
    measuring,
    placing,
    runs,
    servo_gain,
)
from benchmarks.figures import Benchmark
from benchmarks.focus import heights, sweeps
from benchmarks.localisation import convergence, costs, polarity
from benchmarks.optics import (
    coherence,
    extremes,
    layers,
    rendering,
    selector,
    shading,
    vectors,
)
from benchmarks.real import calibrations, gates, point_source, still_frames
from benchmarks.rivals import compile_rival
from benchmarks.robustness import hostile, same_meaning
from benchmarks.selection import feature_sets, kept_sigmas, promises
from benchmarks.truth import pictures, planted, replayed, wave_shift

BENCHMARKS: tuple[Benchmark, ...] = (
    house.BENCHMARK,
    vectors.BENCHMARK,
    extremes.BENCHMARK,
    error_maps.BENCHMARK,
    law_outlines.BENCHMARK,
    rendering.BENCHMARK,
    selector.BENCHMARK,
    layers.BENCHMARK,
    shading.BENCHMARK,
    pictures.BENCHMARK,
    planted.BENCHMARK,
    replayed.BENCHMARK,
    wave_shift.BENCHMARK,
    gates.BENCHMARK,
    still_frames.BENCHMARK,
    point_source.BENCHMARK,
    calibrations.BENCHMARK,
    servo_gain.BENCHMARK,
    coherence.BENCHMARK,
    polarity.BENCHMARK,
    promises.BENCHMARK,
    kept_sigmas.BENCHMARK,
    costs.BENCHMARK,
    feature_sets.BENCHMARK,
    sweeps.BENCHMARK,
    heights.BENCHMARK,
    fit.BENCHMARK,
    fit_outlines.BENCHMARK,
    keyed.BENCHMARK,
    convergence.BENCHMARK,
    hostile.BENCHMARK,
    same_meaning.BENCHMARK,
    imports.BENCHMARK,
    cluster.BENCHMARK,
    times.BENCHMARK,
    memory.BENCHMARK,
    cores.BENCHMARK,
    compile_rival.BENCHMARK,
    stages.BENCHMARK,
    earlier_commits.BENCHMARK,
    machines.BENCHMARK,
    control.BENCHMARK,
    measuring.BENCHMARK,
    runs.BENCHMARK,
    crashes.BENCHMARK,
    placing.BENCHMARK,
    drivers.BENCHMARK,
)
