"""Charts as SVG: a curve, points with a front, bars with a limit, spans, times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from schemas.html.axes import WIDTH, Axes, Scale, bounded
from schemas.html.elements import Element, el
from schemas.html.figures import number
from schemas.html.page import chart

_ROW = 31.0  # height of a bar with its label
_LEFT, _RIGHT = 4.0, 10.0
_ABOVE, _BELOW = 5.0, 14.0  # of the base of a limit's name, from its line
_HIGH = 0.85  # of a chart's height: above there is no room for a name
_LETTER = 6.0  # width of a letter of a name, about
_SHARES = tuple(k / 64 for k in range(65))  # of a piece of a path, looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One point of a chart."""

    x: float
    y: float
    label: str  # told when it is pointed at, and by a screen reader
    kind: str = "dot"  # dot, ring or cross
    named: str = ""  # written beside it


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One bar, of one or more pieces."""

    label: str
    pieces: tuple[tuple[float, str], ...]  # size, class
    said: str  # the size in words; stands at the right
    start: float = 0.0


def curve(
    title: str,
    description: str,
    axes: Axes,
    points: Sequence[tuple[float, float]],
    *,
    here: float | None = None,
    limit: float | None = None,
    limit_name: str = "",
    dots: bool = True,
) -> Element:
    """Return a curve, with the present value across and a limit upwards."""
    path = " ".join(f"{axes.x(x):.1f},{axes.y(y):.1f}" for x, y in points)
    drawn: list[Element] = [*axes.draw()]
    top, bottom = axes.y(axes.up.high), axes.y(axes.up.low)
    lines = [(axes.x(x), axes.y(y)) for x, y in points]
    if limit is not None:
        drawn.append(_limit_line(axes, limit))
    if here is not None:
        x = axes.x(here)
        drawn.append(el("line", x1=x, x2=x, y1=top, y2=bottom, class_="here"))
    drawn.append(el("polyline", points=path, class_="curve"))
    if dots:
        drawn += [el("circle", cx=x, cy=y, r=2.6, class_="dot") for x, y in lines]
    if limit is not None:
        across = [*lines] if here is None else [*lines, (x, bottom), (x, top)]
        drawn.append(_limit_name(axes, limit, limit_name, across))
    return chart(title, description, drawn, width=WIDTH, height=axes.height)


def scatter(
    title: str,
    description: str,
    axes: Axes,
    points: Sequence[Point],
    *,
    front: Sequence[tuple[float, float]] = (),
    chosen: tuple[float, float] | None = None,
    limit: float | None = None,
    limit_name: str = "",
) -> Element:
    """Return points with their front, the choice and a limit upwards."""
    drawn: list[Element] = [*axes.draw()]
    if limit is not None:
        drawn += _limit(axes, limit, limit_name)
    if len(front) > 1:
        drawn.append(el("polyline", points=_stairs(axes, front), class_="front"))
    for point in points:
        drawn.append(_point(axes, point))
    if chosen is not None:
        x, y = axes.x(chosen[0]), axes.y(chosen[1])
        drawn.append(el("circle", cx=x, cy=y, r=8.0, class_="pick"))
    drawn += _names(axes, points)
    return chart(title, description, drawn, width=WIDTH, height=axes.height)


def bars(
    title: str,
    description: str,
    rows: Sequence[Bar],
    *,
    limit: float | None = None,
    limit_name: str = "",
    unit: str = "",
    most: float | None = None,
    least: float = 0.0,
    band: tuple[float, float] | None = None,
) -> Element:
    """Return bars below their labels on one scale that starts at `least`."""
    ends = [bounded(row.start + sum(size for size, _ in row.pieces)) for row in rows]
    high = (
        bounded(most)
        if most is not None
        else max([*ends, 1.22 * bounded(limit or 0.0), 1e-12]) * 1.02
    )
    low = bounded(least)
    scale = Scale(low=low, high=max(high, low + max(1e-9, 1e-9 * abs(low))))
    height = len(rows) * _ROW + 30

    def x(value: float) -> float:
        return _LEFT + min(max(scale.share(value), 0.0), 1.0) * (WIDTH - _LEFT - _RIGHT)

    drawn: list[Element] = []
    if band is not None:
        left, wide = x(band[0]), x(band[1]) - x(band[0])
        drawn.append(
            el("rect", x=left, y=0, width=wide, height=height - 26, class_="band")
        )
    for value in scale.ticks():
        at = x(value)
        drawn.append(el("line", x1=at, x2=at, y1=0, y2=height - 26, class_="grid"))
        place = "tick mid" if at > 14 else "tick"
        drawn.append(el("text", number(value), x=at, y=height - 14, class_=place))
    if unit:
        drawn.append(el("text", unit, x=_LEFT, y=height - 2, class_="tick"))
    if limit is not None:
        at = x(limit)
        drawn.append(el("line", x1=at, x2=at, y1=0, y2=height - 26, class_="limit"))
        words = f"{limit_name} {number(limit)}"
        drawn.append(el("text", words, x=at + 3, y=height - 2, class_="limit end"))
    for k, row in enumerate(rows):
        drawn += _bar(row, k * _ROW, x)
    return chart(title, description, drawn, width=WIDTH, height=height)


def _bar(row: Bar, top: float, x: Callable[[float], float]) -> list[Element]:
    """Return one bar with its label above and its size at the right."""
    drawn = [
        el("text", row.label, x=_LEFT, y=top + 12),
        el("text", row.said, x=WIDTH - _RIGHT, y=top + 12, class_="tick end"),
    ]
    at = row.start
    for size, kind in row.pieces:
        wide = x(at + size) - x(at)
        if wide > 0:
            drawn.append(
                el("rect", x=x(at), y=top + 17, width=max(wide, 0.8), height=8,
                   class_=f"bar {kind}".strip())
            )  # fmt: skip
        at += size
    return drawn


def _limit(axes: Axes, limit: float, name: str) -> list[Element]:
    """Return a limit upwards with its name; below it where there is no room above."""
    x, y = axes.x(axes.across.low), axes.y(limit)
    y += _BELOW if axes.up.share(limit) > _HIGH else -_ABOVE
    return [_limit_line(axes, limit), el("text", name, x=x + 4, y=y, class_="limit")]


def _limit_line(axes: Axes, limit: float) -> Element:
    """Return the line of a limit upwards."""
    x0, x1, y = axes.x(axes.across.low), axes.x(axes.across.high), axes.y(limit)
    return el("line", x1=x0, x2=x1, y1=y, y2=y, class_="limit")


def _limit_name(
    axes: Axes, limit: float, name: str, path: Sequence[tuple[float, float]]
) -> Element:
    """Return a limit's name beside its line, where the path does not cross it."""
    x0, x1, y = axes.x(axes.across.low), axes.x(axes.across.high), axes.y(limit)
    wide, share = _LETTER * len(name), axes.up.share(limit)
    sides = [_BELOW] if share > _HIGH else [-_ABOVE]
    if share <= _HIGH and share > 1 - _HIGH:  # room on both sides of the line
        sides = [-_ABOVE, _BELOW]
    spots = [(x, y + side) for side in sides for x in (x1 - wide, x0 + 4)]
    free = (spot for spot in spots if not _crosses(path, spot, wide))
    left, base = next(free, spots[0])
    if left > x0 + 4:
        return el("text", name, x=x1, y=base, class_="limit end")
    return el("text", name, x=left, y=base, class_="limit")


def _crosses(
    path: Sequence[tuple[float, float]], spot: tuple[float, float], wide: float
) -> bool:
    """Return whether a path runs through words that begin at a spot."""
    left, base = spot
    return any(
        left - 3 < x0 + s * (x1 - x0) < left + wide + 3
        and base - 12 < y0 + s * (y1 - y0) < base + 4
        for (x0, y0), (x1, y1) in pairwise([*path[:1], *path])
        for s in _SHARES
    )


def _point(axes: Axes, point: Point) -> Element:
    """Return a point that tells its name when pointed at."""
    x, y = axes.x(point.x), axes.y(point.y)
    if point.kind == "cross":
        path = f"M{x - 3.4:.1f} {y - 3.4:.1f}l6.8 6.8m0 -6.8l-6.8 6.8"
        return el("path", el("title", point.label), d=path, class_="cross")
    return el("circle", el("title", point.label), cx=x, cy=y, r=3.8, class_=point.kind)


def _stairs(axes: Axes, front: Sequence[tuple[float, float]]) -> str:
    """Return the front as stairs: what nothing cheaper is as accurate as."""
    ordered = sorted(front)
    found = [f"{axes.x(ordered[0][0]):.1f},{axes.y(ordered[0][1]):.1f}"]
    for (_, before), (x, y) in pairwise(ordered):
        found.append(f"{axes.x(x):.1f},{axes.y(before):.1f}")
        found.append(f"{axes.x(x):.1f},{axes.y(y):.1f}")
    return " ".join(found)


def _names(axes: Axes, points: Sequence[Point]) -> list[Element]:
    """Return names near points, each where no other and no point stands."""
    spots = [(axes.x(p.x) - 5, axes.y(p.y), 10.0) for p in points]
    drawn = []
    for point in (p for p in points if p.named):
        x, y = axes.x(point.x), axes.y(point.y)
        wide = 5.7 * len(point.named)
        left = min(max(x - wide / 2, 50.0), WIDTH - wide)
        shifts = sorted((k * 6.0 for k in range(-24, 25)), key=lambda s: (abs(s), s))
        free = [
            spot
            for shift in shifts
            if axes.y(axes.up.high) < y + shift < axes.y(axes.up.low)
            and not any(_meet(spot := (left, y + shift, wide), s) for s in spots)
        ]
        if free:
            spots.append(free[0])
            place = {"x": free[0][0], "y": free[0][1] + 4}
            drawn.append(el("text", point.named, **place))
    return drawn


def _meet(one: tuple[float, float, float], two: tuple[float, float, float]) -> bool:
    """Return whether two things on lines of text overlap: left, middle, width."""
    apart = abs(one[1] - two[1]) >= 12
    beside = one[0] + one[2] < two[0] or two[0] + two[2] < one[0]
    return not (apart or beside)
