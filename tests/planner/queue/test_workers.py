"""What a worker notices of the process that began it."""

from __future__ import annotations

from multiprocessing import Event

import pytest

from microplan.planner.queue import workers
from microplan.planner.queue.workers import StoppedError, listen, until_told


def test_work_that_nobody_wants_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_told", workers._Told())
    assert list(until_told(abs, [-1, 2])) == [1, 2]
    event = Event()
    listen(event)
    found = until_told(abs, [-1, 2])
    assert next(found) == 1
    event.set()
    with pytest.raises(StoppedError):
        next(found)
