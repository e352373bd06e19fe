"""Where a user says that the target of a picture is, about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

LengthUnit = Literal["px", "um"]
NEAR = "X,Y or X,Y,DEG with px or um behind X and Y, as 320px,244px or 12um,-3um,90"


@dataclass(frozen=True, slots=True, kw_only=True)
class NearPlace:
    """A place about which the target is: column and row, px, or world x and y, um."""

    x: float
    y: float
    unit: LengthUnit
    theta_rad: float | None  # of the target, world; None: as the task has it


def parse_near(text: str) -> NearPlace:
    """Return the place that `NEAR` describes; ValueError if it is no such."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) not in (2, 3):
        raise ValueError(text)
    (x, unit), (y, other) = map(_length, parts[:2])
    if unit != other:
        raise ValueError(text)
    theta = math.radians(_finite(parts[2])) if len(parts) == 3 else None
    return NearPlace(x=x, y=y, unit=unit, theta_rad=theta)


def _length(text: str) -> tuple[float, LengthUnit]:
    """Return a number and its unit."""
    units: tuple[LengthUnit, ...] = get_args(LengthUnit)
    for unit in units:
        if text.endswith(unit):
            return _finite(text.removesuffix(unit)), unit
    raise ValueError(text)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
