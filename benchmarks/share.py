"""Which share of a process's CPU time a package takes, whatever it calls."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeVar

_T = TypeVar("_T")
_EVERY_S = 0.01  # of CPU time


@dataclass(slots=True)
class Share:
    """Samples of the main thread's stack, and those in which a package is at work."""

    package: str  # a folder's name
    samples: int = 0
    within: int = 0

    def of(self, work: Callable[[], _T]) -> _T:
        """Return what `work` does, sampling the stack meanwhile.

        The main thread alone can do this, and nothing else may use SIGPROF.
        """
        before = signal.signal(signal.SIGPROF, self._sample)
        signal.setitimer(signal.ITIMER_PROF, _EVERY_S, _EVERY_S)
        try:
            return work()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.signal(signal.SIGPROF, before)

    @property
    def value(self) -> float:
        """Return the share, 0..1; of no samples 0."""
        return self.within / self.samples if self.samples else 0.0

    def _sample(self, _signal: int, frame: FrameType | None) -> None:
        self.samples += 1
        while frame is not None:
            if Path(frame.f_code.co_filename).parent.name == self.package:
                self.within += 1
                return
            frame = frame.f_back
