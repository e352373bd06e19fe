"""Time of the simulated cell: processes advance while it is waited for."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Protocol

from microplan.executor.simulated.faults import Faults
from microplan.executor.simulated.truth import Truth

RENDER_S = 600.0  # that a picture of the simulated camera may take, on a busy machine
HANG_S = 2 * RENDER_S  # of the machine's own time; `stop` ends it


class Process(Protocol):
    """Process that advances by itself while time passes."""

    def due_s(self) -> float:
        """Return when its next step is due; infinity if nothing is under way."""
        ...

    def step(self) -> None:
        """Take the step that is due."""
        ...


class Timeline:
    """Moves the truth's time on, step by step of all processes, in order.

    `lock` is held while a step is taken, so that a stop falls between two steps.
    `changed` is called after every order that a device took.
    """

    def __init__(self, truth: Truth) -> None:
        self.truth = truth
        self.lock = threading.RLock()
        self.changed: Callable[[], None] = lambda: None
        self._processes: list[Process] = []

    def add(self, process: Process) -> None:
        """Let a process take part."""
        self._processes.append(process)

    def advance(self, seconds: float) -> None:
        """Let `seconds` pass."""
        with self.lock:
            end_s = self.truth.time_s + seconds
            while self._processes:
                first = min(self._processes, key=lambda process: process.due_s())
                due_s = first.due_s()
                if due_s > end_s:
                    break
                self.truth.time_s = max(self.truth.time_s, due_s)
                first.step()
            self.truth.time_s = end_s

    def run_out(self, process: Process) -> None:
        """Let time pass until a process is at rest."""
        while (due_s := process.due_s()) < math.inf:
            self.advance(max(due_s - self.truth.time_s, 0.0))


class Delayed:
    """Delayed change of the truth, one at a time."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._due_s = math.inf
        self._change: Callable[[], None] | None = None
        timeline.add(self)

    def begin(self, seconds: float, change: Callable[[], None]) -> None:
        """Make a change in `seconds`; one that was still to come is dropped."""
        with self._timeline.lock:
            self._due_s = self._timeline.truth.time_s + seconds
            self._change = change

    def cancel(self) -> None:
        """Drop the change that is to come, if there is one."""
        with self._timeline.lock:
            self._due_s, self._change = math.inf, None

    def left_s(self) -> float | None:
        """Return the time left until the change, None if there is none to come."""
        if self._change is None:
            return None
        return self._due_s - self._timeline.truth.time_s

    def pending(self) -> bool:
        """Return whether a change is to come."""
        return self._change is not None

    def due_s(self) -> float:
        """Return when the change is due."""
        return self._due_s

    def step(self) -> None:
        """Make the change."""
        change = self._change
        self.cancel()
        if change is not None:
            change()


class DeviceFaults:
    """The faults of one device: `kind` is how their names begin."""

    def __init__(self, faults: Faults, kind: str) -> None:
        self.faults = faults
        self._kind = kind
        self._freed = threading.Event()

    def on(self, name: str) -> bool:
        """Return whether the device's fault `name` is at work."""
        return self.faults.on(f"{self._kind}_{name}")

    def refuse(self, name: str) -> None:
        """Raise what a broken driver raises, if the fault `name` is at work."""
        if self.on(name):
            raise OSError(f"the {self._kind} controller answered E07")

    def hang(self, name: str) -> None:
        """Do not return, if the fault `name` is at work, until `free` is called."""
        if self.on(name):
            self._freed.clear()
            self._freed.wait(HANG_S)

    def free(self) -> None:
        """End a hang."""
        self._freed.set()


class DelayedDevice:
    """A device whose orders come true after a delay, and whose faults can hang it."""

    def __init__(self, timeline: Timeline, trouble: DeviceFaults) -> None:
        self._timeline, self._trouble = timeline, trouble
        self.motion = Delayed(timeline)

    def moving(self) -> bool:
        """Return whether an order is under way."""
        return self.motion.pending()

    def stop(self) -> None:
        """Drop the order that is under way, and end a hang."""
        self._trouble.free()
        if self.motion.pending():
            self.motion.cancel()
            self._timeline.changed()


class SimClock:
    """The cell's own time."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline

    def now_s(self) -> float:
        """Return seconds since the cell was built."""
        return self._timeline.truth.time_s

    def wait(self, seconds: float) -> None:
        """Let the cell's time pass."""
        self._timeline.advance(seconds)
