"""The serial protocol: numbered questions and answers, a line each, with a checksum.

    >3A go focus 12.500000*06        question: number, verb, words
    <3A ok*1E                        answer: the same number, ok and words,
    <3A err range*9D                 or err and why

The number is two hexadecimal digits that the asker counts up; the checksum is the
CRC-8 of all between mark and star. A line ends with a line feed; a carriage return
before it is ignored. What is no such line is noise and is skipped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

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
    """Return what a line answers; None if it is noise.

    Noise before the mark is cut off: a line may begin with what was left of another.
    """
    line = line.rstrip(b"\r\n")
    start = line.rfind(b"<")
    found = _ANSWER.fullmatch(line[start:]) if start >= 0 else None
    if found is None or int(found[4], 16) != crc8(line[start + 1 : -3]):
        return None
    words = tuple(found[3].decode("ascii").split())
    return Answer(int(found[1], 16), found[2] == b"ok", words)
