"""The angle to which flat jaws turn the part that they close on.

Jaws without friction turn a part so that it gets narrower between them: from where it
stands, its width across the jaws falls until an edge lies flat. It is followed angle by
angle; what the jaws do not feel stops nothing, so that the chords that an arc is made
of do not hold a disc.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray

STEP_RAD = math.radians(0.05)  # between widths that are compared
FELT_UM = 0.04  # a rise that stops a rotation: ten times what chords of arcs make
BLOCK = 600  # angles whose widths are made at once
SHRINKS = 60  # of the interval of the least width, by the golden section: to rounding


def settled_rad(corners: FloatArray, start_rad: float) -> float:
    """Return the angle to which jaws along x turn a part, rad.

    The bottom of the valley of the width that it starts in: that on the side where the
    width has first fallen by FELT_UM; where it falls by less, that towards which it
    begins to fall. A part whose width rises by FELT_UM on neither side, as a disc's,
    keeps its angle.

    Parameters
    ----------
    corners : (N, 2) float array
        Of the outline as fabricated, in the part's frame, um.
    start_rad : float
        Angle of the part to the jaws, rad.
    """
    sides = [_descent(corners, start_rad, side) for side in (-1.0, 1.0)]
    valleys = [each for each in sides if each is not None]
    if not valleys:
        return start_rad
    bottom = min(valleys, key=lambda v: (v.fell_rad, v.next_um, v.least_um)).bottom_rad
    return _narrowest(corners, bottom - STEP_RAD, bottom + STEP_RAD)


def widths_um(corners: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Return the width along x of (N, 2) corners turned by (M,) angles, (M,) um."""
    across = np.stack([np.cos(angles_rad), -np.sin(angles_rad)], axis=1) @ corners.T
    found: FloatArray = across.max(axis=1) - across.min(axis=1)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Descent:
    """How a width falls to one side of an angle, up to where it rises by FELT_UM."""

    fell_rad: float  # over which it has fallen by FELT_UM; inf: it never has
    next_um: float  # width one step away
    least_um: float
    bottom_rad: float  # angle of the least width


def _descent(corners: FloatArray, start_rad: float, side: float) -> _Descent | None:
    """Return how a width falls to one side of an angle, None where it never rises."""
    first, least, bottom = math.inf, math.inf, start_rad
    begin_um, next_um = 0.0, 0.0
    for block in range(math.ceil(math.pi / STEP_RAD / BLOCK)):
        first_step = block * BLOCK
        steps = STEP_RAD * np.arange(first_step, first_step + BLOCK + 1, dtype=float)
        widths = widths_um(corners, start_rad + side * steps)
        if block == 0:
            begin_um, next_um = widths[:2].tolist()
        for step, width in zip(steps.tolist(), widths.tolist(), strict=True):
            if width < least:
                least, bottom = width, start_rad + side * step
            if width < begin_um - FELT_UM:
                first = min(first, step)
            if width > least + FELT_UM:
                return _Descent(
                    fell_rad=first, next_um=next_um, least_um=least, bottom_rad=bottom
                )
    return None


def _narrowest(corners: FloatArray, low: float, high: float) -> float:
    """Return the angle of the least width between two around one valley, rad."""
    golden = (math.sqrt(5) - 1) / 2
    for _ in range(SHRINKS):
        part = golden * (high - low)
        left, right = widths_um(corners, np.array([high - part, low + part])).tolist()
        low, high = (low, low + part) if left < right else (high - part, high)
    return (low + high) / 2
