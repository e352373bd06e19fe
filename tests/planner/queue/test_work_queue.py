"""What every adapter of the queue keeps: the results of a plain map, and nothing else.

Chunks are in microplan's or the standard library's modules: workers import them.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, as_completed
from functools import partial
from multiprocessing import Pipe, Process
from multiprocessing.context import SpawnProcess
from pathlib import Path
from threading import Thread
from typing import Any, Protocol

import pytest

from microplan.planner.queue.processes import ProcessQueue
from microplan.planner.queue.work_queue import (
    QueueLostError,
    WorkerDiedError,
    WorkQueue,
)
from microplan.planner.queue.workers import StoppedError
from tests.planner.queue.chunks import (
    answer,
    die_once,
    killed,
    own_pid,
    recorded,
    refuse,
    square,
)


class Opened(Protocol):
    def __call__(self, workers: int) -> WorkQueue: ...


@pytest.fixture(params=["processes", "cluster"])
def opened(request: pytest.FixtureRequest) -> Iterator[Opened]:
    """Yield what makes a queue of some workers; it is closed afterwards."""
    made: list[Callable[[], None]] = []

    def make(workers: int) -> WorkQueue:
        if request.param == "processes":
            queue: WorkQueue = ProcessQueue(workers)
        else:
            pytest.importorskip("distributed")
            from tests.planner.queue.local_cluster import local_queue

            queue, end = local_queue(workers)
            made.append(end)
        made.append(queue.close)
        return queue

    yield make
    for end in reversed(made):
        end()


def test_results_are_those_of_map_in_order(opened: Opened) -> None:
    queue, numbers = opened(2), range(-20, 20)
    work = [queue.submit(partial(square, n)) for n in numbers]
    assert [each.result() for each in work] == [n * n for n in numbers]


def test_an_error_is_raised_where_its_result_is_wanted(opened: Opened) -> None:
    queue = opened(2)
    good, bad, late = (queue.submit(partial(refuse, n)) for n in (1, -1, 2))
    assert (good.result(), late.result()) == (1, 2)
    with pytest.raises(ValueError, match="-1 is refused"):
        bad.result()


def test_a_killed_worker_costs_no_result(opened: Opened, tmp_path: Path) -> None:
    queue = opened(2)
    work = [queue.submit(partial(die_once, tmp_path / "died", 7, n)) for n in range(12)]
    assert [each.result() for each in work] == list(range(12))
    assert (tmp_path / "died").exists()
    assert queue.submit(partial(square, 3)).result() == 9


def test_a_chunk_that_kills_every_worker_is_given_up(opened: Opened) -> None:
    queue = opened(1)
    with pytest.raises(WorkerDiedError, match=r"^workers died .* at the same work$"):
        queue.submit(killed).result()
    assert queue.submit(partial(square, 3)).result() == 9


def test_the_most_urgent_is_begun_first(opened: Opened, tmp_path: Path) -> None:
    queue, log = opened(1), tmp_path / "log"
    # what is under way, and next, when the others are added
    first = [queue.submit(partial(recorded, log, -1, 0.4)) for _ in range(2)]
    time.sleep(0.1)
    urgent = [3, 1, 4, 1, 5, 9, 2, 6]
    work = [queue.submit(partial(recorded, log, n, 0.0), n) for n in urgent]
    for _ in as_completed([*first, *work]):
        pass
    assert log.read_text().split() == ["-1", "-1", *"96543211"]


def test_what_is_cancelled_is_not_done(opened: Opened, tmp_path: Path) -> None:
    queue, log = opened(1), tmp_path / "log"
    work = [queue.submit(partial(recorded, log, n, 0.3)) for n in range(2)]
    late = queue.submit(partial(recorded, log, 9, 0.0))
    assert late.cancel()
    assert [each.result() for each in work] == [0, 1]
    queue.submit(partial(recorded, log, 2, 0.0)).result()
    with pytest.raises(CancelledError):
        late.result()
    assert log.read_text().split() == ["0", "1", "2"]


def test_nothing_runs_after_close() -> None:
    queue = ProcessQueue(2)
    asked = [queue.submit(partial(own_pid, n)) for n in range(8)]
    pids = {each.result() for each in asked}
    waiting = [queue.submit(partial(time.sleep, 0.1)) for _ in range(40)]
    queue.close()
    assert sum(each.cancelled() for each in waiting) > 30
    assert all(each.done() for each in waiting)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, signal.SIG_DFL)


def test_a_deadly_chunk_takes_no_other_with_it() -> None:
    queue = ProcessQueue(2)
    bad = queue.submit(killed)
    good = [queue.submit(partial(recorded, Path(os.devnull), n, 0.2)) for n in range(3)]
    assert [each.result() for each in good] == [0, 1, 2]
    with pytest.raises(WorkerDiedError):
        bad.result()
    queue.close()


def test_who_waits_hears_that_no_process_can_be_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise OSError("too many open files")

    queue = ProcessQueue(1)
    monkeypatch.setattr(SpawnProcess, "_Popen", staticmethod(refused))
    work: list[Future[Any]] = [queue.submit(killed)]
    work += [queue.submit(partial(abs, n)) for n in range(9)]
    for each in (work[0], work[-1]):
        with pytest.raises(QueueLostError, match="too many open files"):
            each.result(timeout=60)
    with pytest.raises(QueueLostError):
        queue.submit(killed)
    queue.close()


def test_what_is_submitted_while_a_queue_closes_is_answered() -> None:
    queue = ProcessQueue(1)
    work: list[Future[Any]] = []

    def feed() -> None:
        while True:
            try:
                work.append(queue.submit(partial(square, 2)))
            except StoppedError:
                return

    feeder = Thread(target=feed)
    feeder.start()
    work[:] = [queue.submit(partial(square, 1))]
    work[0].result()
    queue.close()
    feeder.join()
    assert all(each.done() for each in work)


def test_close_ends_no_process_of_another() -> None:
    queue = ProcessQueue(1)
    ours, theirs = Pipe()
    child = Process(target=answer, args=(theirs,))
    child.start()
    theirs.close()
    queue.close()
    ours.send(2)
    assert ours.recv() == 2
    child.join()
