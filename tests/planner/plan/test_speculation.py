"""Looks compiled before their turn: which, in what order, and when they are used."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.plan import open_queue
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.options import Options
from microplan.planner.plan.speculation import begin
from microplan.planner.queue.processes import ProcessQueue
from microplan.planner.queue.turns import Turns
from microplan.planner.queue.workers import StoppedError
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.views.requests import requests
from microplan.schemas.plan import dump_plan
from tests.planner.examples import EXAMPLE, FEW, copy_example, one_look, read

EFFECTS = CompileContext(effort=PRESETS["fast"], max_image_error=0.01, map=map)


class Held(Turns):
    """Takes work, and leaves it undone."""

    def __init__(self) -> None:
        self.waiting: list[Future[Any]] = []

    def start(self, work: Callable[[], Any]) -> Future[Any]:
        self.waiting.append(Future())
        return self.waiting[-1]

    def of(self, found: Future[Any]) -> Any:
        return found.result()


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


POOL = """
import os, time
from functools import partial
from microplan.planner.plan.open_queue import opened
with opened(2, None) as queue:
    queue.submit(partial(time.sleep, 300))
    print(os.getpid(), *queue._pool._processes, flush=True)
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


class Deadly(ProcessQueue):
    """Loses a process at every thirtieth chunk."""

    taken = 0

    def submit(self, chunk: Callable[[], Any], priority: float = 0.0) -> Future[Any]:
        self.taken += 1
        if self.taken % 30 == 10:
            with contextlib.suppress(ProcessLookupError, StopIteration):
                os.kill(next(iter(self._pool._processes or {})), signal.SIGKILL)
        return super().submit(chunk, priority)


@pytest.mark.slow  # a look, three times
def test_dead_workers_and_jobs_change_no_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = copy_example(tmp_path / "task")
    one_look(file)
    found = []
    for jobs, queue in ((1, ProcessQueue), (3, ProcessQueue), (2, Deadly)):
        monkeypatch.setattr(open_queue, "ProcessQueue", queue)
        options = Options(preset="fast", effort=FEW, max_image_error=0.1, jobs=jobs)
        made = compile_task(read(file), Report(), options)
        assert made is not None
        found.append(dump_plan(made.plan))
    assert found[0] == found[1] == found[2]
