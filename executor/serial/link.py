"""The serial protocol: numbered questions over a raw port, each answer to its question.

    >3A go focus 12.500000*06        question: number, verb, words
    <3A ok*1E                        answer: the same number, ok and words,
    <3A err range*9D                 or err and why

The number is two hexadecimal digits that the asker counts up; the checksum is the
CRC-8 of all between mark and star. A line ends with a line feed; a carriage return
before it is ignored. What is no such line is noise and is skipped.
"""

from __future__ import annotations

import itertools
import os
import re
import select
import termios
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.executor.devices.errors import ExecutorError

LONGEST = 96  # bytes of a line, its end included
NUMBERS = 256  # questions are numbered modulo this
POLYNOMIAL = 0x07  # of the CRC-8, x^8 + x^2 + x + 1: ITU-T I.432.1
_ANSWER = re.compile(rb"<([0-9A-F]{2}) (ok|err)((?: [!-~]+)*)\*([0-9A-F]{2})")
_WORD = re.compile(r"[!-)+-~]+")  # printable, no space, no star


class RefusedError(OSError):
    """The device answered that it will not."""


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer: to which question, whether it was accepted, and the words."""

    number: int
    accepted: bool
    words: tuple[str, ...]


def crc8(data: bytes) -> int:
    """Return the CRC-8 of some bytes, started at 0."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ POLYNOMIAL) & 0xFF if crc & 0x80 else crc << 1
    return crc


def question(number: int, words: Sequence[str]) -> bytes:
    """Return the line of a question.

    Raises
    ------
    ValueError
        If a word cannot be sent, or the line is too long.
    """
    for word in words:
        if not _WORD.fullmatch(word):
            raise ValueError(f"{word!r} cannot be sent")
    body = f"{number % NUMBERS:02X} {' '.join(words)}".encode("ascii")
    line = b">" + body + b"*%02X\n" % crc8(body)
    if len(line) > LONGEST:
        raise ValueError(f"a line of {len(line)} bytes, at most {LONGEST}")
    return line


def answer(line: bytes) -> Answer | None:
    """Return the answer in a line; None if it is noise.

    Noise before the mark is cut off: a line may begin with what was left of another.
    """
    line = line.rstrip(b"\r\n")
    start = line.rfind(b"<")
    found = _ANSWER.fullmatch(line[start:]) if start >= 0 else None
    if found is None or int(found[4], 16) != crc8(line[start + 1 : -3]):
        return None
    words = tuple(found[3].decode("ascii").split())
    return Answer(int(found[1], 16), found[2] == b"ok", words)


_CHUNK = 4096
SPEEDS = {
    rate: getattr(termios, f"B{rate}")
    for rate in (9600, 19200, 38400, 57600, 115200, 230400)
}


class Port:
    """A port, opened and set to 8 bits, no parity, no flow control."""

    def __init__(self, path: str, baud: int = 115200) -> None:
        if baud not in SPEEDS:
            allowed = ", ".join(str(rate) for rate in SPEEDS)
            raise ValueError(f"baud = {baud}, allowed: {allowed}")
        self.path = path
        self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            _set_raw(self._file, SPEEDS[baud])
        except termios.error as error:  # which is no OSError
            os.close(self._file)
            raise OSError(f"{path} is no serial port: {error}") from error
        self._rest = b""  # read, and not a whole line yet
        self._writing = threading.Lock()

    def write(self, line: bytes, until_s: float) -> None:
        """Send a line, whole, before a time of `time.monotonic`.

        Raises
        ------
        TimeoutError
            If the port does not take it.
        OSError
            If the port is gone.
        """
        with self._writing:
            while line:
                left_s = until_s - time.monotonic()
                if not select.select([], [self._file], [], max(left_s, 0.0))[1]:
                    raise TimeoutError(f"{self.path} takes no bytes")
                line = line[os.write(self._file, line) :]

    def lines(self, until_s: float) -> list[bytes]:
        """Return the lines that came, after waiting for the first at most so long.

        Of bytes without a line's end only the last are kept: noise fills no memory.
        One thread at a time may ask.

        Raises
        ------
        OSError
            If the port is gone.
        """
        while b"\n" not in self._rest:
            left_s = until_s - time.monotonic()
            if left_s <= 0 or not select.select([self._file], [], [], left_s)[0]:
                return []
            data = os.read(self._file, _CHUNK)
            if not data:
                raise OSError(f"{self.path} is gone")
            self._rest += data
            if b"\n" not in self._rest:
                self._rest = self._rest[-LONGEST:]
        *whole, self._rest = self._rest.split(b"\n")
        return whole

    def close(self) -> None:
        """Close the port; harmless twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _set_raw(file: int, speed: int) -> None:
    """Set a terminal to raw bytes, and drop what it still holds."""
    mode = termios.tcgetattr(file)
    mode[0] = mode[1] = mode[3] = 0  # input, output, line: nothing is done to bytes
    mode[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
    mode[4] = mode[5] = speed
    mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 0
    termios.tcsetattr(file, termios.TCSANOW, mode)
    termios.tcflush(file, termios.TCIOFLUSH)


TRIES = 3  # every order is an absolute state: asked again it does nothing new
ANSWER_S = 0.1  # a line of 96 bytes takes 8 ms at 115200 baud
_SLICE_S = 0.01  # between two looks at whether another thread took the answer


class Link:
    """A port on which several threads may ask at once.

    A stop does not wait for the answer to another question: questions are
    numbered, and the thread that reads passes each answer on.
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
            If the device refuses.
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
