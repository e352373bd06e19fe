"""What `microplan tradeoff --vary` names: axes, and values of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

Axis = Literal["preset", "trials", "frames", "zoom"]
Vary = Sequence[tuple[Axis, tuple[str, ...]]]  # axes and values; (): its usual ones

AXES: tuple[Axis, ...] = get_args(Axis)


def parse_vary(text: str) -> Vary:
    """Return axes and values of `preset,trials=24:64`; ValueError if it is no such."""
    found: list[tuple[Axis, tuple[str, ...]]] = []
    for part in text.split(","):
        name, equals, values = part.partition("=")
        axis = next((axis for axis in AXES if axis == name.strip()), None)
        if axis is None or (equals and not values):
            raise ValueError(text)
        if any(axis == other for other, _ in found):
            raise ValueError(text)
        found.append((axis, tuple(values.split(":")) if equals else ()))
    return found
