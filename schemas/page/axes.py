"""Axes of a chart: positions of values, ticks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import number

WIDTH, HEIGHT = 360.0, 224.0  # of all charts, in units of their text
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 12.0, 12.0, 40.0
_FAR = 1e30  # beyond, differences and ratios might be no numbers any more


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisScale:
    """Values from `low` to `high`, evenly or by their logarithms."""

    low: float
    high: float
    log: bool = False

    def __post_init__(self) -> None:
        if not self.high > self.low:
            raise ValueError(f"a scale rises, got {self.low}..{self.high}")
        if self.log and not self.low > 0:
            raise ValueError(f"a logarithm needs low > 0, got {self.low}")

    def share(self, value: float) -> float:
        """Return a value's position, 0 at the low end and 1 at the high one."""
        value = bounded(value)
        if self.log:
            value = max(value, self.low)
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """Return round values on the scale, four to nine where it has them."""
        narrow = self.high < 5 * self.low  # it may hold no 1, 2 or 5
        return _decades(self) if self.log and not narrow else _even(self)


def bounded(value: float) -> float:
    """Return a value, or the nearest that a chart can work with."""
    return min(max(value, -_FAR), _FAR)


def around(values: list[float], *, zero: bool = False) -> AxisScale:
    """Return an even scale that holds all values, with a little room."""
    low, high = bounded(min(values)), bounded(max(values))
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    room = 0.05 * (high - low) or abs(high) * 0.1 or 1.0
    return AxisScale(low=low if zero and low == 0 else low - room, high=high + room)


def around_log(values: list[float], *, room: float = 1.5) -> AxisScale:
    """Return a logarithmic scale that holds all values above 0, `room` times more."""
    known = [min(max(value, 1 / _FAR), _FAR) for value in values if value > 0] or [1.0]
    return AxisScale(low=min(known) / room, high=max(known) * room, log=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartField:
    """The field of a chart between its two scales."""

    across: AxisScale
    up: AxisScale
    across_label: str
    up_label: str
    height: float = HEIGHT

    def x(self, value: float) -> float:
        """Return a value's position across."""
        return _LEFT + self.across.share(value) * (WIDTH - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        """Return a value's position, downwards."""
        room = self.height - _TOP - _BOTTOM
        return self.height - _BOTTOM - self.up.share(value) * room

    def draw(self) -> Iterator[Element]:
        """Yield grid, ticks and labels."""
        left, right = _LEFT, WIDTH - _RIGHT
        top, bottom = _TOP, self.height - _BOTTOM
        for value in self.up.ticks():
            y = self.y(value)
            yield el("line", x1=left, x2=right, y1=y, y2=y, class_="grid")
            yield el("text", number(value), x=left - 6, y=y + 4, class_="tick end")
        for value in self.across.ticks():
            x = self.x(value)
            yield el("line", x1=x, x2=x, y1=bottom, y2=bottom + 4, class_="axis")
            yield el("text", number(value), x=x, y=bottom + 16, class_="tick mid")
        yield el("line", x1=left, x2=right, y1=bottom, y2=bottom, class_="axis")
        middle = (left + right) / 2
        yield el("text", self.across_label, x=middle, y=self.height - 6, class_="mid")
        turned = f"translate(11 {(top + bottom) / 2:.1f}) rotate(-90)"
        yield el("text", self.up_label, transform=turned, class_="mid")


def _even(scale: AxisScale) -> list[float]:
    """Return multiples of 1, 2 or 5 times a power of ten."""
    rough = (scale.high - scale.low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough)
    first, last = math.ceil(scale.low / step), math.floor(scale.high / step)
    return [k * step for k in range(first, last + 1)]


def _decades(scale: AxisScale) -> list[float]:
    """Return powers of ten, with 2 and 5 between them where there are few."""
    first, last = math.floor(math.log10(scale.low)), math.ceil(math.log10(scale.high))
    steps = (1, 2, 5) if last - first <= 3 else (1,)
    found = [k * 10.0**power for power in range(first, last + 1) for k in steps]
    return [round(v, 12) for v in found if scale.low <= v <= scale.high]
