"""Following of outer devices: their readings become the simulated cell's truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.safety import AXES
from microplan.executor.simulated.axes import STEP_RAD, STEP_UM
from microplan.executor.simulated.cell import Cell
from microplan.executor.simulated.contact import touch
from microplan.executor.simulated.truth import AxisState

DIGITS = 6  # of a reading, um: what differs by less has not moved


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceReadings:
    """Readings of outer devices now; None is not read, and stays as it is."""

    stage: AxisReading | None = None
    robot: AxisReading | None = None
    opening_um: float | None = None  # only of jaws at rest
    magnification: float | None = None
    focus_um: float | None = None
    level: float | None = None


def follow(cell: Cell, readings: DeviceReadings, now_s: float) -> None:
    """Bring a cell to where outer devices are, in steps in which things may touch.

    The axes' own errors are left out: the outer readings are the truth. Jaws and lens
    are ordered only what changed, and each change of the lens has its errors.

    Parameters
    ----------
    cell : Cell
        What is led.
    readings : DeviceReadings
        Where to.
    now_s : float
        The time of it, never less than before; drift runs by it.

    Raises
    ------
    ValueError
        If jaws or lens read what the cell's own cannot reach.
    """
    truth = cell.truth
    truth.time_s = max(truth.time_s, now_s)
    for state, reading in (
        (truth.stage, readings.stage),
        (truth.robot, readings.robot),
    ):
        if reading is not None:
            _lead(cell, state, {a: float(getattr(reading, a)) for a in AXES})
    if _changed(readings.opening_um, cell.jaws.reading()):
        cell.jaws.move(round(readings.opening_um or 0.0, DIGITS))
    magnification, focus_um = cell.lens.reading()
    if _changed(readings.magnification, magnification):
        cell.lens.set_magnification(readings.magnification or 0.0)
    if _changed(readings.focus_um, focus_um):
        cell.lens.set_focus_um(readings.focus_um or 0.0)
    if readings.level is not None:
        cell.light.set_level(readings.level)


def _changed(now: float | None, before: float) -> bool:
    """Return whether a reading is another one, and no rounding of the old."""
    return now is not None and round(now - before, DIGITS) != 0


def _lead(cell: Cell, state: AxisState, target: Mapping[str, float]) -> None:
    """Take one axis group to its readings."""
    start = dict(state.actual)
    count = math.ceil(
        max(abs(target[a] - start[a]) / STEP_UM.get(a, STEP_RAD) for a in AXES)
    )
    for taken in range(1, count + 1):
        share = taken / count
        for axis in AXES:
            at = start[axis] + share * (target[axis] - start[axis])
            state.actual[axis] = target[axis] if taken == count else at
            state.commanded[axis] = state.actual[axis]
        touch(cell.truth, lambda: cell.faults.on("block"))
