"""A serial port as the operating system has it: raw bytes in and out, never waiting."""

from __future__ import annotations

import os
import select
import termios
import threading
import time

from microplan.executor.serial.protocol import LONGEST

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
