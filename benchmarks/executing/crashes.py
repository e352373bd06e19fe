"""Executors killed at every write and every action, and again while they recover."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.figures import Benchmark, Figure, Options
from tests.executor.whole_runs.crashing import (
    Fate,
    Outcome,
    all_fates,
    hurried,
    outcome,
    pairs,
    small_job,
)

TWICE = 700  # jobs whose second executor is killed too
CHUNK = 100  # jobs a process takes at once
NAMES = (
    "executor.crash_wrong",
    "executor.crash_runs",
    "executor.crash_twice",
    "executor.crash_asked",
)

Fates = tuple[Fate, ...]


def outcomes(fates: Sequence[Fates]) -> list[Outcome]:
    """Return what came of the job, once for each way its executors die."""
    with TemporaryDirectory() as name, hurried():
        job = small_job(Path(name) / "gear.plan")
        return [outcome(job, each) for each in fates]


def every_death() -> list[Fates]:
    """Return every single death at the job, and as many double ones as are drawn."""
    with TemporaryDirectory() as name, hurried():
        single = all_fates(small_job(Path(name) / "gear.plan"))
    return [*((fate,) for fate in single), *pairs(single, TWICE)]


def _measure(options: Options) -> Iterator[Figure]:
    fates = every_death()
    chunks = [fates[i : i + CHUNK] for i in range(0, len(fates), CHUNK)]
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(options.jobs) as pool:
        found = [each for part in pool.map(outcomes, chunks, chunksize=1)
                 for each in part]  # fmt: skip
    for each in found:
        if each.wrong:
            print(f"wrong: {each.fates}: {each.wrong}")
    met = [each for each in found if each.met]
    twice = sum(len(each.fates) == 2 for each in met)
    wrong = sum(bool(each.wrong) for each in found)
    asked = sum(each.asked for each in found)
    for name, value in zip(NAMES, (wrong, len(met), twice, asked), strict=True):
        yield Figure(name=name, value=value, unit="runs")


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
