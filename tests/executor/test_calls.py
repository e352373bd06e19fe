"""Calls of devices that nobody waits for any more."""

from __future__ import annotations

import signal
import threading

import pytest

from executor.calls import Caller


def test_what_an_interrupted_call_begins_is_stopped() -> None:
    """Stops overtake a call that is under way: its motion would go on."""
    main = threading.main_thread().ident or 0
    under_way, stopped, late = threading.Event(), threading.Event(), threading.Event()

    def start() -> None:
        under_way.set()
        stopped.wait(10.0)  # the stop comes first

    def interrupt() -> None:
        under_way.wait(10.0)
        signal.pthread_kill(main, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        Caller().call("stage.start", start, 10.0, late=late.set)
    thread.join()
    stopped.set()
    assert late.wait(10.0)
