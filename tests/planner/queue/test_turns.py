"""Control flows that share a queue: one runs at a time, results are those of `map`."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from functools import partial
from pathlib import Path

import pytest

from microplan.planner.plan import open_queue
from microplan.planner.plan.open_queue import SchedulerError, turns_of
from microplan.planner.queue.processes import ProcessQueue
from microplan.planner.queue.turns import Elsewhere, Turns
from microplan.planner.queue.workers import StoppedError
from microplan.planner.source.diagnostics import Report
from tests.planner.queue.chunks import killed, recorded, refuse, square

Shared = tuple[ProcessQueue, Turns]


@pytest.fixture
def shared() -> Iterator[Shared]:
    """Yield a queue of two processes, and turns of four flows at it."""
    queue = ProcessQueue(2)
    turns = Turns(queue, 4)
    yield queue, turns
    queue.close()
    turns.close()


def test_flows_have_the_results_of_map_and_run_one_at_a_time(shared: Shared) -> None:
    _, turns = shared
    inside: list[int] = []
    most: list[int] = []

    def flow(number: int) -> list[int]:
        spread, found = turns.map(number, Elsewhere()), list(range(number))
        for _ in range(3):
            inside.append(number)
            time.sleep(0.002)
            most.append(len(inside))
            inside.remove(number)
            found = list(spread(square, found))
        return found

    flows = [turns.start(partial(flow, number)) for number in range(6)]
    mine = list(turns.map(9.0, Elsewhere())(square, range(5)))
    assert mine == [0, 1, 4, 9, 16]
    for number, each in enumerate(flows):
        assert turns.of(each) == [n**8 for n in range(number)]
    assert max(most) == 1
    assert len(most) == 18


def test_an_error_of_a_flow_is_raised_where_it_is_waited_for(shared: Shared) -> None:
    _, turns = shared

    def flow() -> list[int]:
        return list(turns.map(0.0, Elsewhere())(refuse, [1, -1]))

    bad, good = turns.start(flow), turns.start(lambda: 3)
    with pytest.raises(ValueError, match="-1 is refused"):
        turns.of(bad)
    assert turns.of(good) == 3


def test_a_map_is_no_part_of_a_key(shared: Shared) -> None:
    """`Memo.call` leaves functions out; a map of another kind would be in every key."""
    from microplan.planner.store.memo import _is_means

    assert _is_means(shared[1].map(0.0, Elsewhere()))


def test_flows_end_when_the_queue_is_closed() -> None:
    before = threading.active_count()
    queue = ProcessQueue(1)
    turns = Turns(queue, 4)

    def flow() -> None:
        while True:
            list(turns.map(0.0, Elsewhere())(time.sleep, [0.01] * 20))

    flows: list[Future[None]] = [turns.start(flow) for _ in range(3)]
    assert list(turns.map(1.0, Elsewhere())(square, [2])) == [4]
    queue.close()
    turns.close()
    for each in flows:
        with pytest.raises((StoppedError, CancelledError)):
            each.result()
    assert threading.active_count() == before


def test_a_map_that_is_left_takes_the_rest_back(tmp_path: Path) -> None:
    log, queue = tmp_path / "log", ProcessQueue(1)
    turns = Turns(queue, 1)
    spread = turns.map(0.0, Elsewhere())
    found = spread(partial(recorded, log, pause_s=0.05), range(50))
    next(found)
    del found
    queue.submit(partial(recorded, log, 99, 0.0)).result()
    assert len(log.read_text().split()) < 10
    queue.close()
    turns.close()


def test_turns_end_though_others_have_the_turn() -> None:
    queue = ProcessQueue(1)
    turns = Turns(queue, 2)
    left = turns._others()
    left.__enter__()  # and Ctrl-C, before the turn is back
    flow = turns.start(lambda: list(turns.map(0.0, Elsewhere())(square, [3])))
    assert flow.result() == [9]
    queue.close()
    turns.close()


def test_a_second_ctrl_c_leaves_nobody_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Interrupted(ProcessQueue):
        def close(self) -> None:
            if self._thread.is_alive():
                os.kill(os.getpid(), signal.SIGINT)
            super().close()

    flows: list[Future[int]] = []

    def interrupted() -> None:
        with turns_of(2, None, Report()) as turns:
            assert turns is not None
            flows.extend(turns.start(lambda: 1) for _ in range(9))
            raise KeyboardInterrupt

    monkeypatch.setattr(open_queue, "ProcessQueue", Interrupted)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert all(each.done() for each in flows)
    assert signal.getsignal(signal.SIGINT) == before


def test_workers_that_die_at_the_same_work_are_a_finding() -> None:
    def deadly() -> None:
        with turns_of(2, None, Report()) as turns:
            assert turns is not None
            list(turns.map(0.0, Elsewhere())(killed, [1]))

    with pytest.raises(SchedulerError, match="died three times") as said:
        deadly()
    assert said.value.code == "MP731"
    assert said.value.hint == "fewer --jobs need less memory"
