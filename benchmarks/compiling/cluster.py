"""How well a sweep uses a cluster's workers: a Dask cluster on this machine."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import once_s
from microplan.planner.source.diagnostics import Report
from microplan.planner.sweep.sweeping import TABLE, SweepCall, write_sweep
from tests.planner.examples import copy_example, one_look

TASKS = 40
NAMES = ("cluster.efficiency", "cluster.busy")


def _measure(options: Options) -> Iterator[Figure]:
    """Yield the time of one process over that of all workers, and how busy they are."""
    if importlib.util.find_spec("distributed") is None:
        return
    with TemporaryDirectory() as name:
        yield from _measured(Path(name), options.jobs)


def _measured(folder: Path, workers: int) -> Iterator[Figure]:
    from tests.planner.queue.local_cluster import local_cluster

    task = copy_example(folder / "task")
    one_look(task)
    alone, shared = folder / "alone", folder / "shared"
    alone_s = once_s(lambda: _sweep(task, alone, None))
    with local_cluster(workers) as cluster:
        shared_s = once_s(lambda: _sweep(task, shared, cluster.scheduler_address))
    if _column(alone, "plan_sha256") != _column(shared, "plan_sha256"):
        raise RuntimeError("a cluster's plans are others")
    share = alone_s / (workers * shared_s)
    yield Figure(name=NAMES[0], value=share, unit="1")
    rows_s = sum(map(float, _column(shared, "time_s")))
    yield Figure(name=NAMES[1], value=rows_s / (workers * shared_s), unit="1")


def _sweep(task: Path, out: Path, scheduler: str | None) -> None:
    """Compile one look with as many seeds as there are tasks, nothing kept."""
    seeds = ",".join(map(str, range(TASKS)))
    asked = (("optimise.prefer", "fast"), ("seed", seeds))
    report = Report()
    write_sweep(
        str(task), SweepCall(settings=asked, out=out, scheduler=scheduler), report
    )
    if report.failed:
        raise RuntimeError(f"not swept: {report.found}")


def _column(out: Path, name: str) -> list[str]:
    """Return a column of a sweep's table."""
    text = (out / TABLE).read_text(encoding="utf-8")
    return [row[name] for row in csv.DictReader(io.StringIO(text))]


BENCHMARK = Benchmark(names=NAMES, measure=_measure, may_lack=frozenset(NAMES))
