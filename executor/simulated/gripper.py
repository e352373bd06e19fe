"""The jaws of the simulated cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from microplan.executor.simulated.contact import touch
from microplan.executor.simulated.jaws import close_jaws, open_jaws
from microplan.executor.simulated.timeline import Delayed, DeviceFaults, Timeline

JAW_TIME_S = 0.3  # the workcell states none


class SimGripper:
    """Jaws; `stick` is the chance that a released part follows a finger."""

    def __init__(
        self,
        timeline: Timeline,
        rng: np.random.Generator,
        trouble: DeviceFaults,
        *,
        stick: float = 0.0,
    ) -> None:
        self._timeline = timeline
        self._truth = timeline.truth
        self._rng = rng
        self._trouble = trouble
        self._stick = stick
        self._commanded = self._truth.opening_um
        self._target_um = self._commanded
        self.motion = Delayed(timeline)

    @property
    def model(self) -> str:
        """Return what the device is."""
        return "simulated jaws"

    @property
    def serial(self) -> str:
        """Return the device's number."""
        return "sim-jaws"

    def start(self, opening_um: float) -> None:
        """Begin to open or close; see `microplan.executor.devices.drivers.Gripper`."""
        tool = self._truth.tool
        low, high = (0.0, 0.0) if tool is None else tool.opening_um
        if not (math.isfinite(opening_um) and low <= opening_um <= high):
            raise ValueError(
                f"opening {opening_um:g} um is outside {low:g}..{high:g} um"
            )
        self._trouble.refuse("raise")
        self._begin(JAW_TIME_S, opening_um)
        self._timeline.changed()

    def move(self, opening_um: float) -> None:
        """Start a motion and let the cell's time pass until it has ended."""
        self.start(opening_um)
        self._timeline.run_out(self.motion)

    def reading(self) -> float:
        """Return the commanded opening: the drive does not feel what it holds."""
        if self.motion.pending():
            self._trouble.hang("hang")
            if self._trouble.on("nan"):
                return math.nan
        return self._commanded

    def moving(self) -> bool:
        """Return whether the jaws are under way."""
        return self.motion.pending()

    def stop(self) -> None:
        """Leave the jaws where they are."""
        self._trouble.free()
        if self.motion.pending():
            self.motion.cancel()
            self._timeline.changed()

    def state(self) -> dict[str, Any]:
        """Return the command, and the motion under way."""
        return {
            "commanded_um": self._commanded,
            "target_um": self._target_um,
            "left_s": self.motion.left_s(),
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Be where `state` says."""
        self._commanded, self._target_um = data["commanded_um"], data["target_um"]
        if data["left_s"] is not None:
            self._begin(data["left_s"], data["target_um"])

    def _begin(self, seconds: float, opening_um: float) -> None:
        """Begin a motion that ends in `seconds`."""
        self._target_um = opening_um
        self.motion.begin(seconds, lambda: self._arrive(opening_um))

    def _arrive(self, opening_um: float) -> None:
        """Be at the new opening, with whatever is between the jaws or was."""
        if self._trouble.on("stuck"):
            return
        if opening_um < self._truth.opening_um:
            close_jaws(self._truth, opening_um)
        else:
            holds = bool(self._truth.held)
            chance = 1.0 if holds and self._trouble.faults.on("stick") else self._stick
            sticks, side = self._rng.random(2)
            stuck = float(np.sign(side - 0.5)) if sticks < chance else 0.0
            open_jaws(self._truth, opening_um, stick_side=stuck)
        self._commanded = opening_um
        touch(self._truth)
