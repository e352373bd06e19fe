"""A paced drive: small steps at a set speed, while it is watched."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from microplan.executor.micromanager.drives import Drive

LONGEST_S = 0.1  # of a gap between two looks at the drive that still counts as motion


@dataclass(frozen=True, slots=True)
class _Way:
    """A straight path, and the share of it that the drive was sent, 0 to 1."""

    start: Mapping[str, float]
    target: Mapping[str, float]
    length: float
    share: float
    since_s: float


class Paced:
    """Lets another drive go slowly: for devices that jump, or know no speed.

    It takes a step whenever its reading or motion is asked for. If that ends, so
    does the motion: it does not outlive the program that watches it.

    Parameters
    ----------
    drive : Drive
        What is moved.
    own_per_s : float
        The speed where none is ordered, and the highest, unit/s.
    now_s : callable
        Seconds of a clock that never goes back.
    """

    def __init__(
        self,
        drive: Drive,
        *,
        own_per_s: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._drive, self._own_per_s, self._now_s = drive, own_per_s, now_s
        self._per_s = own_per_s
        self._way: _Way | None = None
        self._orders = 0  # counts starts and stops, so that a step sees that it is late
        self._stepping = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of its numbers."""
        return self._drive.names

    @property
    def label(self) -> str:
        """Return the device's label."""
        return self._drive.label

    def check(self, targets: Mapping[str, float]) -> None:
        """Refuse what the drive refuses."""
        self._drive.check(targets)

    def pace(self, per_s: float | None) -> None:
        """Choose the speed of the next motion."""
        wanted = self._own_per_s if per_s is None else per_s
        if not wanted > 0:  # also refuses nan
            raise ValueError(f"{self.label}: a speed of {wanted:g}/s")
        self._per_s = min(wanted, self._own_per_s)

    def go(self, targets: Mapping[str, float]) -> None:
        """Begin to move; the first step comes with the first look at it."""
        start = self._drive.read()
        length = max((abs(v - start[n]) for n, v in targets.items()), default=0.0)
        self._orders += 1
        self._way = _Way(start, dict(targets), length, 0.0, self._now_s())

    def read(self) -> dict[str, float]:
        """Return its present values, a step further on."""
        self._step()
        return self._drive.read()

    def busy(self) -> bool:
        """Return whether the motion is still under way."""
        self._step()
        return self._way is not None or self._drive.busy()

    def stop(self) -> None:
        """Go no further; from any thread."""
        self._orders += 1
        self._way = None
        self._drive.stop()

    def _step(self) -> None:
        """Send the drive as far as it may be by now."""
        if not self._stepping.acquire(blocking=False):
            return  # another thread takes this step
        try:
            order, way = self._orders, self._way
            if way is None or self._drive.busy():
                return
            on = self._further(way)
            ahead = {
                n: v
                if on.share == 1.0
                else way.start[n] + on.share * (v - way.start[n])
                for n, v in way.target.items()
            }
            self._drive.go(ahead)
            if self._orders != order:  # stopped, or sent elsewhere, meanwhile
                self._drive.stop()
            else:
                self._way = on if on.share < 1.0 else None
        finally:
            self._stepping.release()

    def _further(self, way: _Way) -> _Way:
        """Return the path's state after the time that has passed."""
        now_s = self._now_s()
        passed_s = min(now_s - way.since_s, LONGEST_S)
        more = self._per_s * passed_s / way.length if way.length else 1.0
        share = min(way.share + more, 1.0)
        return _Way(way.start, way.target, way.length, share, now_s)
