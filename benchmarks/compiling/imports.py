"""Start-up times: the package itself, the executor, `microplan check`."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import best_s, once_s, python_s
from microplan.planner.drawings.dxf.drawing import load_drawing
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.read_task import load_task
from microplan.planner.task.second_reader import MAX_ITEMS, compare, read_twice

REPEATS = 15
NAMES = (
    "executor.import_ratio",
    "planner.check_s",
    "microplan.import_ms",
    "planner.second_reader_s",
    "planner.second_reader_most_s",
)


def _measure(_options: Options) -> Iterator[Figure]:
    calls = (
        ["-c", "import microplan.executor.cli.main"],
        ["-m", "microplan.planner.cli.main", "check", str(TASK)],
        ["-c", "import numpy"],
        ["-c", "import microplan"],
        ["-c", "pass"],
    )
    # taken in turns, so that a busy moment meets all
    rounds = [[python_s(call) for call in calls] for _ in range(REPEATS)]
    executor, check, numpy, package, python = (
        min(times) for times in zip(*rounds, strict=True)
    )
    yield Figure(name=NAMES[0], value=executor / numpy, unit="1")
    yield Figure(name=NAMES[1], value=check - numpy, unit="s")  # beyond numpy
    # beyond Python itself
    yield Figure(name=NAMES[2], value=(package - python) * 1e3, unit="ms")
    task = load_task(TASK, Report())
    if task is None:
        raise RuntimeError("the example cannot be read")
    # three drawings, each in a process of its own, as `compile` begins
    yield Figure(name=NAMES[3], value=best_s(lambda: read_twice(task, Report()), 3),
                 unit="s")  # fmt: skip
    # as many entities as it is given, of a kind that takes it longest
    file = "  0\nSECTION\n  2\nENTITIES\n  0\nCIRCLE\n 10\n0\n 20\n0\n 40\n9\n"
    file += "  0\nODD\n" * (MAX_ITEMS - 4) + "  0\nENDSEC\n  0\nEOF\n"
    at, report = Span(file="odd.dxf"), Report()
    drawing = load_drawing(file.encode(), at.file, "um", at, at, report)
    if drawing is None:
        raise RuntimeError(f"not read: {report.found}")
    most = once_s(lambda: compare(drawing, [], report))
    if report.found:
        raise RuntimeError(f"not read twice: {report.found}")
    yield Figure(name=NAMES[4], value=most, unit="s")


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
