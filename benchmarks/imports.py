"""What starting the executor and `microplan check` cost, next to importing numpy."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import best_s, python_s
from planner.diagnostics import Report
from planner.inputs.read_task import load_task
from planner.inputs.second_reader import read_twice

REPEATS = 15
NAMES = ("executor.import_ratio", "planner.check_s", "planner.second_reader_s")


def _measure(_options: Options) -> Iterator[Figure]:
    calls = (
        ["-c", "import executor.cli"],
        ["-m", "planner.cli", "check", str(TASK)],
        ["-c", "import numpy"],
    )
    # taken in turns, so that a busy moment meets all
    rounds = [[python_s(call) for call in calls] for _ in range(REPEATS)]
    executor, check, numpy = (min(times) for times in zip(*rounds, strict=True))
    yield Figure(name=NAMES[0], value=executor / numpy, unit="1")
    yield Figure(name=NAMES[1], value=check - numpy, unit="s")  # beyond numpy
    task = load_task(TASK, Report())
    if task is None:
        raise RuntimeError("the example cannot be read")
    # three drawings, each in a process of its own, as `compile` begins
    yield Figure(name=NAMES[2], value=best_s(lambda: read_twice(task, Report()), 3),
                 unit="s")  # fmt: skip


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
