"""Calls of devices that nobody waits for any more."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType

import pytest

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.timeouts import Caller
from microplan.executor.motion.motion import Motion
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import AxisMove
from tests.executor.bench import world


@contextmanager
def interrupted_when(under_way: threading.Event) -> Iterator[None]:
    """Interrupt what is done inside, once, as soon as a call is under way.

    A signal that comes just before a thread begins to wait does not wake it: it is sent
    until it has been taken.
    """
    taken, main = threading.Event(), threading.main_thread().ident or 0

    def take(_number: int, _frame: FrameType | None) -> None:
        if not taken.is_set():
            taken.set()
            raise KeyboardInterrupt

    def send() -> None:
        under_way.wait(10.0)
        while not taken.wait(0.01):
            signal.pthread_kill(main, signal.SIGINT)

    before = signal.signal(signal.SIGINT, take)
    thread = threading.Thread(target=send)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            yield
    finally:
        taken.set()
        thread.join()
        signal.signal(signal.SIGINT, before)


def test_what_an_interrupted_call_begins_is_stopped() -> None:
    """Stops overtake a call that is under way: its motion would go on."""
    under_way, stopped, late = threading.Event(), threading.Event(), threading.Event()

    def start() -> None:
        under_way.set()
        stopped.wait(10.0)  # the stop comes first

    with interrupted_when(under_way):
        Caller().call("stage.start", start, 10.0, late=late.set)
    stopped.set()
    assert late.wait(10.0)


class Slow:
    """A stage whose order begins its motion after the stop that overtook it."""

    model, serial = "slow", "1"

    def __init__(self, stop_fails: bool = False) -> None:
        self.told: list[str] = []
        self.under_way, self._stopped = threading.Event(), threading.Event()
        self._stop_fails = stop_fails

    def start(self, **_targets: float | None) -> None:
        self.under_way.set()
        self._stopped.wait(10.0)
        time.sleep(0.2)  # long after a process that does not wait would have ended
        self.told.append("begun")

    def stop(self) -> None:
        if self._stop_fails and self.told:
            raise OSError("cable")
        self.told.append("stop")
        self._stopped.set()

    def reading(self) -> AxisReading:
        return AxisReading(x_um=-600.0, y_um=0.0, z_um=0.0, theta_rad=0.0)

    def moving(self) -> bool:
        return False


def interrupted(stage: Slow, call_s: float) -> list[str]:
    """Interrupt a motion while its order is under way; return what a stop says then."""
    station = build_cell(world(), 0).station
    safety = replace(station.rules.safety, call_s=call_s)
    rules = replace(station.rules, safety=safety)
    station = replace(station, stage=stage, rules=rules)
    motion = Motion()
    with interrupted_when(stage.under_way):
        motion.travel(station, AxisMove(axes="stage", x_um=-590.0), "approach")
    assert stage.told[:1] == ["stop"]
    return motion.stop(station)


def test_a_run_that_is_interrupted_waits_for_the_stop_of_what_begins_late() -> None:
    stage = Slow()
    assert interrupted(stage, 10.0) == []
    assert stage.told[:3] == ["stop", "begun", "stop"]


def test_a_motion_that_may_still_begin_is_told() -> None:
    stage = Slow()
    (left,) = interrupted(stage, 0.02)
    assert left == ("stage.start has not returned: what it begins will not be stopped")


def test_a_late_stop_that_fails_is_told() -> None:
    assert "stage.start returned late, its stop: OSError: cable" in interrupted(
        Slow(stop_fails=True), 10.0
    )
