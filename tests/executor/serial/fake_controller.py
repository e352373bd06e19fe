"""A fake controller behind a pseudo-terminal, with zoom, focus, jaws and its faults.

It speaks the protocol of `microplan.executor.serial` from its description: it shares no
code with the driver, so that a mistake in one of them shows.
"""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType

LATE_S = 0.3  # more than a driver waits
FAULTS: Mapping[str, str] = {
    "silent": "it answers nothing",
    "silent_once": "one answer is missing",
    "corrupt": "a bit of every answer is flipped",
    "corrupt_once": "a bit of one answer is flipped",
    "cut": "every answer ends before its checksum",
    "split": "every answer comes in two pieces",
    "noise": "lines of noise, nulls and bytes beyond ASCII come before every answer",
    "flood": "bytes without any line's end come all the time",
    "echo": "the line echoes every question",
    "twice": "every answer comes twice",
    "late": "every answer comes after the driver has given up waiting",
    "late_once": "one answer comes after the driver has given up waiting",
    "other": "every answer has another question's number",
    "refuses": "it answers every order with an error",
    "words": "the answer to a reading has a word too few",
    "nan": "the reading of a moving axis is nan",
    "text": "the reading is no number",
    "stuck": "an axis never reports an end",
    "short": "an axis stops half way and says it stands",
    "unplugged": "the port is gone",
}
SPEED = {"zoom": 100.0, "focus": 400.0, "jaws": 200.0}  # per s
START = {"zoom": 6.9, "focus": 0.0, "jaws": 130.0}


@dataclass(slots=True)
class _MovingAxis:
    """An axis on its way; at rest where `seconds` is 0."""

    place: float
    goal: float
    began_s: float = 0.0
    seconds: float = 0.0

    def now(self) -> tuple[float, bool]:
        """Return where it is, and whether it moves."""
        share = (
            min((time.monotonic() - self.began_s) / self.seconds, 1.0)
            if self.seconds
            else 1.0
        )
        return (self.place + share * (self.goal - self.place), share < 1.0)


class FakeController:
    """A controller; a context manager. `path` is its port, `fault` what is wrong.

    Attributes
    ----------
    path : str
        The port to open.
    fault : str
        A key of `FAULTS`, or "".
    orders : list of str
        What it was told to do, in order; readings are left out.
    """

    def __init__(self, fault: str = "") -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.fault = fault
        self.orders: list[str] = []
        self._axes = {name: _MovingAxis(value, value) for name, value in START.items()}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> FakeController:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()
        for file in (self._master, self._slave):
            if file >= 0:
                os.close(file)

    def inject(self, fault: str) -> None:
        """Let something go wrong from now on; ValueError if nobody knows it."""
        if fault and fault not in FAULTS:
            raise ValueError(f"no fault is called {fault!r}")
        self.fault = fault
        if fault == "unplugged":
            self._ended.set()
            self._thread.join()
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1

    def moving(self) -> bool:
        """Return whether anything truly moves."""
        return any(axis.now()[1] for axis in self._axes.values())

    def _serve(self) -> None:
        """Answer lines until the end."""
        rest = b""
        while not self._ended.is_set():
            if self.fault == "flood":
                self._send(b"\xff\x00<" * 100)
            if not select.select([self._master], [], [], 0.005)[0]:
                continue
            *lines, rest = (rest + os.read(self._master, 1024)).split(b"\n")
            for line in lines:
                if not self._ended.is_set():
                    self._take(line)

    def _take(self, line: bytes) -> None:
        """Do what a line says, and answer."""
        star = line.rfind(b"*")
        if line[:1] != b">" or star < 0 or line[star + 1 :] != _check(line[1:star]):
            return
        number, _, text = line[1:star].decode("ascii").partition(" ")
        fault = self.fault
        if fault.endswith("_once"):
            self.fault = ""
        if fault == "echo":
            self._send(line + b"\n")
        body = f"{number} {self._done(text.split(), fault)}".encode("ascii")
        _SENT.get(fault, _plain)(self._send, body)

    def _done(self, words: list[str], fault: str) -> str:
        """Return the answer to a question that was understood."""
        verb = words[0]
        if verb == "id":
            return "ok fake-zoom-3 SN17"
        if verb == "at":
            return self._reading(words[1], fault)
        self.orders.append(" ".join(words))
        if verb == "stop":
            for name in words[1:]:
                place, _ = self._axes[name].now()
                self._axes[name] = _MovingAxis(place, place)
            return "ok"
        place, _ = self._axes[words[1]].now()
        if fault == "refuses":
            return "err E07 overload"
        goal = float(words[2])
        if fault == "short":
            goal = (place + goal) / 2
        seconds = abs(goal - place) / SPEED[words[1]]
        self._axes[words[1]] = _MovingAxis(place, goal, time.monotonic(), seconds)
        return "ok"

    def _reading(self, name: str, fault: str) -> str:
        """Return where an axis is, and whether it moves."""
        place, moving = self._axes[name].now()
        if fault == "stuck" and any(order.startswith("go") for order in self.orders):
            moving = True
        if fault == "words":
            return f"ok {place:.6f}"
        if fault == "text":
            return f"ok 1O.5 {int(moving)}"
        if fault == "nan" and moving:
            return "ok nan 1"
        return f"ok {place:.6f} {int(moving)}"

    def _send(self, data: bytes) -> None:
        """Send bytes; what a full port does not take is lost, as on a real line."""
        if select.select([], [self._master], [], 0.0)[1]:
            os.write(self._master, data)


def _check(body: bytes) -> bytes:
    """Return the checksum: the remainder of the body, as a polynomial, over 0x107."""
    value = int.from_bytes(body, "big") << 8
    for bit in range(value.bit_length() - 1, 7, -1):
        if value >> bit & 1:
            value ^= 0x107 << (bit - 8)
    return b"%02X" % value


Send = Callable[[bytes], None]


def _line(body: bytes) -> bytes:
    """Return an answer as it should be."""
    return b"<" + body + b"*" + _check(body) + b"\r\n"


def _plain(send: Send, body: bytes) -> None:
    send(_line(body))


def _nothing(send: Send, body: bytes) -> None:
    """Send nothing."""


def _corrupt(send: Send, body: bytes) -> None:
    line = bytearray(_line(body))
    line[len(line) // 2] ^= 0x04
    send(bytes(line))


def _cut(send: Send, body: bytes) -> None:
    send(_line(body)[:-4])


def _split(send: Send, body: bytes) -> None:
    line = _line(body)
    send(line[:5])
    time.sleep(0.01)
    send(line[5:])


def _noise(send: Send, body: bytes) -> None:
    send(b"\x00\xfe\r\n<ZZ ok*00\n<<<00 ok\n*\n<07 " + _line(body))


def _twice(send: Send, body: bytes) -> None:
    send(_line(body) * 2)


def _late(send: Send, body: bytes) -> None:
    time.sleep(LATE_S)
    send(_line(body))


def _other(send: Send, body: bytes) -> None:
    number = (int(body[:2], 16) + 128) % 256
    send(_line(b"%02X" % number + body[2:]))


_SENT: Mapping[str, Callable[[Send, bytes], None]] = {
    "silent": _nothing, "silent_once": _nothing, "corrupt": _corrupt,
    "corrupt_once": _corrupt, "cut": _cut, "split": _split, "noise": _noise,
    "twice": _twice, "late": _late, "late_once": _late, "other": _other,
}  # fmt: skip
