"""The clock of a real station."""

from __future__ import annotations

import time


class WallClock:
    """Seconds since it was made, by the machine's monotonic clock."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def now_s(self) -> float:
        """Return seconds since the clock was made."""
        return time.monotonic() - self._began_s

    def wait(self, seconds: float) -> None:
        """Sleep for `seconds`."""
        time.sleep(max(seconds, 0.0))
