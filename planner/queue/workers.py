"""What a worker process knows of the one that began it: its end, its change of mind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.synchronize import Event
from signal import SIG_IGN, SIGINT, signal
from threading import Thread, local
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


class StoppedError(Exception):
    """The result is not wanted any more."""


def until_told(function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
    """Yield `function` of each item; StoppedError once the results are not wanted."""
    for item in items:
        if _told.unwanted():
            raise StoppedError
        yield function(item)


def unwanted_when(told: Callable[[], bool]) -> None:
    """Set what says that this thread's results are not wanted any more."""
    _told.unwanted = told


def listen(unwanted: Event) -> None:
    """Set the event that stops this process, and end it with the one that began it.

    Ctrl-C is for that one. A pool's processes do not notice when that is killed: each
    waits for the next task on a pipe that the others hold open.
    """
    unwanted_when(unwanted.is_set)
    parent = parent_process()
    if parent is not None:
        signal(SIGINT, SIG_IGN)
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when another one does."""
    wait([sentinel])
    os._exit(1)


class _Told(local):
    """What a thread knows: all is wanted unless it is told."""

    def __init__(self) -> None:
        self.unwanted: Callable[[], bool] = bool


_told = _Told()
