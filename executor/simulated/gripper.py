"""The jaws of the simulated cell."""

from __future__ import annotations

import math

import numpy as np

from executor.simulated.contact import touch
from executor.simulated.jaws import close_jaws, open_jaws
from executor.simulated.timeline import Delayed, Timeline, Trouble

JAW_TIME_S = 0.3  # the workcell states none


class SimGripper:
    """Jaws; `stick` is the chance that a released part follows a finger."""

    def __init__(
        self,
        timeline: Timeline,
        rng: np.random.Generator,
        trouble: Trouble,
        *,
        stick: float = 0.0,
    ) -> None:
        self._timeline = timeline
        self._truth = timeline.truth
        self._rng = rng
        self._trouble = trouble
        self._stick = stick
        self._commanded = self._truth.opening_um
        self._motion = Delayed(timeline)

    @property
    def model(self) -> str:
        """Return what the device is."""
        return "simulated jaws"

    @property
    def serial(self) -> str:
        """Return the device's number."""
        return "sim-jaws"

    def start(self, opening_um: float) -> None:
        """Begin to open or close; see `executor.drivers.Gripper`."""
        tool = self._truth.tool
        low, high = (0.0, 0.0) if tool is None else tool.opening_um
        if not (math.isfinite(opening_um) and low <= opening_um <= high):
            raise ValueError(
                f"opening {opening_um:g} um is outside {low:g}..{high:g} um"
            )
        self._trouble.refuse("raise")
        self._motion.begin(JAW_TIME_S, lambda: self._arrive(opening_um))

    def move(self, opening_um: float) -> None:
        """Start a motion and let the cell's time pass until it has ended."""
        self.start(opening_um)
        self._timeline.run_out(self._motion)

    def reading(self) -> float:
        """Return the commanded opening: the drive does not feel what it holds."""
        if self._motion.pending():
            self._trouble.hang("hang")
            if self._trouble.on("nan"):
                return math.nan
        return self._commanded

    def moving(self) -> bool:
        """Return whether the jaws are under way."""
        return self._motion.pending()

    def stop(self) -> None:
        """Leave the jaws where they are."""
        self._trouble.free()
        self._motion.cancel()

    def _arrive(self, opening_um: float) -> None:
        """Be at the new opening, with whatever is between the jaws or was."""
        if self._trouble.on("stuck"):
            return
        if opening_um < self._truth.opening_um:
            close_jaws(self._truth, opening_um)
        else:
            sticks, side = self._rng.random(2)
            stuck = float(np.sign(side - 0.5)) if sticks < self._stick else 0.0
            open_jaws(self._truth, opening_um, stick_side=stuck)
        self._commanded = opening_um
        touch(self._truth)
