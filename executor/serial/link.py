"""Questions and answers over a port, from any thread, each answer to its question."""

from __future__ import annotations

import itertools
import threading
import time

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.serial.port import Port
from microplan.executor.serial.protocol import (
    NUMBERS,
    Answer,
    RefusedError,
    answer,
    question,
)

TRIES = 3  # every order is an absolute state: asked again it does nothing new
ANSWER_S = 0.1  # a line of 96 bytes takes 8 ms at 115200 baud
_SLICE_S = 0.01  # between two looks at whether another thread took the answer


class Link:
    """A port on which several threads may ask at once.

    A stop does not wait for the answer that somebody else is waiting for: questions are
    numbered, and whoever reads hands each answer on.
    """

    def __init__(self, port: Port, *, answer_s: float = ANSWER_S) -> None:
        if not answer_s > 0:  # also refuses nan
            raise ValueError(f"answer_s must be positive, got {answer_s}")
        self._port, self._answer_s = port, answer_s
        self._numbers = itertools.count()
        self._reading = threading.Lock()
        self._wanted: dict[int, Answer | None] = {}

    def ask(self, *words: str) -> tuple[str, ...]:
        """Return the words of the answer.

        Raises
        ------
        ExecutorError
            MP844 if no answer comes.
        RefusedError
            If the device says no.
        OSError
            If the port is gone.
        """
        for _ in range(TRIES):
            found = self._try(words)
            if found is None:
                continue
            if not found.accepted:
                raise RefusedError(f"{' '.join(words)}: {' '.join(found.words)}")
            return found.words
        raise ExecutorError(
            "MP844",
            f"{self._port.path} did not answer {words[0]!r} in {TRIES} tries of "
            f"{self._answer_s:g} s",
        )

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _try(self, words: tuple[str, ...]) -> Answer | None:
        """Ask once; None if no answer came."""
        number = next(self._numbers) % NUMBERS
        until_s = time.monotonic() + self._answer_s
        self._wanted[number] = None
        try:
            self._port.write(question(number, words), until_s)
            while time.monotonic() < until_s and self._wanted[number] is None:
                self._read(min(until_s, time.monotonic() + _SLICE_S))
            return self._wanted[number]
        except TimeoutError:
            return None
        finally:
            del self._wanted[number]

    def _read(self, until_s: float) -> None:
        """Read what has come, or wait for the thread that does."""
        if not self._reading.acquire(timeout=max(until_s - time.monotonic(), 0.0)):
            return
        try:
            for line in self._port.lines(until_s):
                found = answer(line)
                if found is not None and found.number in self._wanted:
                    self._wanted[found.number] = found
        finally:
            self._reading.release()
