"""A task of two steps without a look: its rows are made in no time."""

from __future__ import annotations

import atexit
import csv
import io
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from microplan.planner.source.diagnostics import Report
from microplan.planner.store.store import Store
from microplan.planner.sweep.sweeping import TABLE, SweepCall, write_sweep
from tests.planner.examples import GRASP, between_jaws, copy_example, cut

RELEASE = "{id: release, do: release, target: gear, opening_um: 130}"
SETTINGS = (("environment.humidity", "0.1,0.5,0.9"), ("seed", "1,2"))
Row = dict[str, str]


def no_looks(folder: Path) -> Path:
    """Return the task's file in a new folder."""
    file = copy_example(folder)
    between_jaws(file)
    cut(file, GRASP, RELEASE)
    return file


@cache
def readings() -> Path:
    """Return a cache that all tests share: drawings are read twice but once."""
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def swept(
    task: Path, out: Path, *, jobs: int = 1, scheduler: str | None = None
) -> list[Row]:
    """Return the rows of a sweep over humidity and seed, without their times."""
    shown: list[str] = []
    call = SweepCall(
        settings=SETTINGS,
        out=out,
        jobs=jobs,
        scheduler=scheduler,
        store=Store(readings()),
        show=shown.append,
    )
    report = Report()
    write_sweep(str(task), call, report)
    assert not report.failed
    assert len(shown) == 1 + 6
    return table(out)


def table(out: Path) -> list[Row]:
    """Return the rows of a sweep's CSV file, without their times."""
    rows = list(csv.DictReader(io.StringIO((out / TABLE).read_text())))
    return [{k: v for k, v in row.items() if k != "time_s"} for row in rows]
