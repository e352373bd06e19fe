"""Options of a compile, with the axes that a tradeoff varies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.presets import Effort, Preset


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options that override the task's own; None leaves it to the task."""

    preset: Preset | None = None
    effort: Effort | None = None  # None: the preset's
    max_image_error: float | None = None
    jobs: int = 1
    progress: Callable[[int, int, str], None] = lambda _done, _all, _step: None
    memo: Memo = EVERY_TIME  # what is kept between compiles; by itself nothing


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
