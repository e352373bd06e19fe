"""Moves of the axes: which group goes where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

AxesName = Literal["stage", "robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMove:
    """Absolute targets of one axis group, moved together; None leaves an axis."""

    axes: AxesName  # which group moves
    x_um: float | None = None  # reading to go to
    y_um: float | None = None  # reading to go to
    z_um: float | None = None  # reading to go to
    theta_rad: float | None = None  # reading to go to
    speed_um_per_s: float | None = None  # None: the axes' own speed
