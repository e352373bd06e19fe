"""Which share of a process's CPU time a package takes, whatever it calls."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, ModuleType
from typing import TypeVar

_T = TypeVar("_T")
_EVERY_S = 0.01  # of CPU time


@dataclass(slots=True)
class Share:
    """The CPU time of a process, and that while a package was on the main stack.

    The stack is looked at every 10 ms of it, or once a longer call of C returns: what
    went by since counts for where it returns to.
    """

    package: ModuleType  # with a folder of its own
    clock: Callable[[], float] = time.process_time
    total_s: float = 0.0
    within_s: float = 0.0
    _last_s: float = 0.0

    def of(self, work: Callable[[], _T]) -> _T:
        """Return what `work` does, looking at the stack meanwhile.

        The main thread alone can do this, and nothing else may use SIGPROF.
        """
        before = signal.signal(signal.SIGPROF, self._look)
        self._last_s = self.clock()
        signal.setitimer(signal.ITIMER_PROF, _EVERY_S, _EVERY_S)
        try:
            return work()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.signal(signal.SIGPROF, before)

    @property
    def value(self) -> float:
        """Return the share, 0..1; of no time 0."""
        return self.within_s / self.total_s if self.total_s else 0.0

    def _look(self, _signal: int, frame: FrameType | None) -> None:
        now_s = self.clock()
        went_s, self._last_s = now_s - self._last_s, now_s
        self.total_s += went_s
        folder = str(Path(str(self.package.__file__)).parent)
        while frame is not None:
            if frame.f_code.co_filename.startswith(folder):
                self.within_s += went_s
                return
            frame = frame.f_back
