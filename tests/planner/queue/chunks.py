"""Chunks for tests: some die, some write down when they were done."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path


def square(number: int) -> int:
    """Return the square."""
    return number * number


def refuse(number: int) -> int:
    """Return the number; ValueError where it is negative."""
    if number < 0:
        raise ValueError(f"{number} is refused")
    return number


def own_pid(_: object) -> int:
    """Return this process's number."""
    return os.getpid()


def killed(_: object = None) -> None:
    """Kill this process."""
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(mark: Path, victim: int, number: int) -> int:
    """Return the number; kill this process at the victim, unless it died before."""
    time.sleep(0.01)
    if number == victim and not mark.exists():
        mark.touch()
        killed()
    return number


def recorded(log: Path, number: int, pause_s: float) -> int:
    """Return the number, and add it to a log after a pause."""
    time.sleep(pause_s)
    with log.open("a") as stream:
        stream.write(f"{number}\n")
    return number


def answer(asked: Connection) -> None:
    """Send back the one thing that comes."""
    asked.send(asked.recv())
