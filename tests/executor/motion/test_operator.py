"""Ctrl-C: once pauses between two motions, twice stops."""

from __future__ import annotations

import os
import signal

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.operator import Operator


def interrupted(times: int = 1) -> None:
    """Send the process an interrupt, as a terminal does."""
    for _ in range(times):
        os.kill(os.getpid(), signal.SIGINT)


def test_without_an_interrupt_nothing_waits() -> None:
    asked: list[int] = []

    def ask() -> bool:
        asked.append(1)
        return False

    with Operator(ask) as operator:
        operator.pause()
    assert asked == []


def test_one_interrupt_asks_and_goes_on() -> None:
    asked: list[int] = []

    def ask() -> bool:
        asked.append(1)
        return True

    with Operator(ask) as operator:
        interrupted()
        operator.pause()
        operator.pause()
        assert asked == [1]
        interrupted()  # it counts from the start again
        operator.pause()
    assert asked == [1, 1]


@pytest.mark.parametrize("ask", [None, lambda: False], ids=["nobody there", "says no"])
def test_one_interrupt_stops_if_nobody_says_go_on(ask: None) -> None:
    with Operator(ask) as operator:
        interrupted()
        with pytest.raises(ExecutorError, match="stopped by the operator") as caught:
            operator.pause()
    assert caught.value.code == "MP860"


def test_two_interrupts_stop_at_once_also_while_it_asks() -> None:
    with Operator() as operator, pytest.raises(KeyboardInterrupt):
        interrupted(2)

    def ask() -> bool:
        interrupted()
        return True

    with Operator(ask) as operator:
        interrupted()
        with pytest.raises(KeyboardInterrupt):
            operator.pause()


def test_a_request_to_terminate_stops_at_once_and_more_are_ignored() -> None:
    with Operator():
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
        interrupted()


def test_interrupts_go_back_to_whom_they_were() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Operator():
        assert signal.getsignal(signal.SIGINT) != before
    assert signal.getsignal(signal.SIGINT) == before


def test_a_terminal_that_is_closed_stops_at_once() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run by nohup
    try:
        with Operator(), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_run_that_is_to_outlive_its_terminal_goes_on() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with Operator() as operator:
            os.kill(os.getpid(), signal.SIGHUP)
            operator.pause()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
