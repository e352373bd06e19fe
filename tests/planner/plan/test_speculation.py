"""Looks compiled before their turn: which, in what order, and when they are used."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from multiprocessing import Event
from pathlib import Path
from typing import Any

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.looks.progress.work import (
    CompileProgress,
    Work,
    count,
    images_of,
    shared_counts,
)
from microplan.planner.plan import speculation as ahead
from microplan.planner.plan.compiler import workers
from microplan.planner.plan.speculation import StoppedError, begin, listen, until_told
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.views.requests import requests
from tests.planner.examples import EXAMPLE, copy_example, one_look, read

EFFECTS = CompileContext(effort=PRESETS["fast"], max_image_error=0.01, map=map)


class Held(Executor):
    """Takes work, and leaves it undone."""

    def __init__(self) -> None:
        self.waiting: list[Future[Any]] = []

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        self.waiting.append(Future())
        return self.waiting[-1]


def test_all_looks_are_begun_and_the_one_before_an_insertion_first() -> None:
    task = read(EXAMPLE / "task.yaml")
    pool = Held()
    found = begin(pool, task, unfold(task, Report()), EFFECTS, 6.9)
    assert len(pool.waiting) == 8
    names = list(found.under_way)
    assert names[0] == "over_shaft"
    assert sorted(names) == [
        "bring_between", "check_seated.seat", "check_seated.target", "find_gear",
        "find_shaft", "gear_in_fingers", "over_shaft", "see_fingers",
    ]  # fmt: skip


def test_a_look_made_ahead_is_used_only_for_the_same_request(tmp_path: Path) -> None:
    """A round hole has no angle; nobody asked for one ahead."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report, pool = read(file), Report(), Held()
    states = unfold(task, report)
    low, _ = task.workcell.optics.magnification
    (asked,) = requests(task, states, 0, None)

    found = begin(pool, task, states, EFFECTS, low)
    other = replace(asked, needs_angle_rad=1.0)
    assert found.looks(task, other, EFFECTS, low, report) == ()
    assert [d.code for d in report.found] == ["MP502"]
    assert pool.waiting[0].cancelled()

    found = begin(pool, task, states, EFFECTS, low)
    pool.waiting[1].set_exception(StoppedError())
    with pytest.raises(StoppedError):  # what its process says of it
        found.looks(task, asked, EFFECTS, low, report)


def test_what_waits_for_a_look_made_elsewhere_says_how_far_it_is(
    tmp_path: Path,
) -> None:
    """It stops waiting only for what is said."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report, pool = read(file), Report(), Held()
    states = unfold(task, report)
    low, _ = task.workcell.optics.magnification
    (asked,) = requests(task, states, 0, None)
    heard: list[CompileProgress] = []

    def hears(reached: CompileProgress) -> None:
        heard.append(reached)
        if not pool.waiting[0].done():
            count(work.counts, 0, "race", 3)  # as the other process does
            if len(heard) == 2:
                pool.waiting[0].set_exception(StoppedError())

    work = Work(heard=hears)
    found = begin(pool, task, states, EFFECTS, low, work)
    with pytest.raises(StoppedError):
        found.looks(task, asked, EFFECTS, low, report)
    assert [each.here.made for each in heard] == [0, 3]
    assert [each.stage for each in heard] == ["", "race"]


def two_images() -> None:
    """Count two images of look 3 of a race, in the process that this runs in."""
    assert ahead._counts is not None
    count(ahead._counts, 3, "race", 2)


def test_other_processes_count_where_this_one_reads() -> None:
    counts = shared_counts()
    with workers(2, counts) as pool:
        assert pool is not None
        pool.submit(two_images).result()
    assert images_of(counts, 3)[0] == 2
    assert sum(counts) == 2


POOL = """
import os, time
from microplan.planner.plan.compiler import workers
with workers(2) as pool:
    pool.submit(time.sleep, 300)
    print(os.getpid(), *pool._processes, flush=True)
    time.sleep(300)
"""


def runs(pid: int) -> bool:
    """Return whether a process runs; one that has ended may not be collected yet."""
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_no_process_outlives_a_compiler_that_is_killed() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", POOL], stdout=subprocess.PIPE, text=True
    ) as compiler:
        assert compiler.stdout is not None
        own, *pids = map(int, compiler.stdout.readline().split())
        assert own == compiler.pid
        assert len(pids) > 0
        assert all(map(runs, pids))
        compiler.kill()
    deadline = time.monotonic() + 60
    while any(map(runs, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(runs, pids))


def test_work_that_nobody_wants_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_unwanted", None)
    assert list(until_told(abs, [-1, 2])) == [1, 2]
    event = Event()
    listen(event)
    found = until_told(abs, [-1, 2])
    assert next(found) == 1
    event.set()
    with pytest.raises(StoppedError):
        next(found)
