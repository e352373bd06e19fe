"""Charts as SVG: curve, scatter with a front, bars with a limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from microplan.schemas.page.axes import WIDTH, AxisScale, ChartField, bounded
from microplan.schemas.page.elements import Element, el, visible
from microplan.schemas.page.figures import number
from microplan.schemas.page.labels import (
    LabelBox,
    Segment,
    number_boxes,
    shortened,
    width,
)
from microplan.schemas.page.page import chart

_ROW = 31.0  # height of a bar with its label
_LEFT, _RIGHT = 4.0, 10.0
_ABOVE, _BELOW = 5.0, 14.0  # of the base of a limit's name, from its line
_HIGH = 0.85  # of a chart's height: above there is no room for a name
_SIZE, _SMALL = 11.0, 10.5  # of letters, as in the style sheet: names, and ticks
_OVER, _UNDER = 10.5, 3.5  # how far letters reach from their base
_MARK, _PICK = 4.5, 9.0  # radii that names keep off: a point, and the choice
_LINE = 16.0  # of a bar's row: its words; the bar is below them
_GAP = 3.0  # between words and a line that is broken at them


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartPoint:
    """One point of a chart."""

    x: float
    y: float
    label: str  # shown by a pointing device and read by a screen reader
    kind: str = "dot"  # dot, ring or cross
    named: str = ""  # its name in the legend, which gives it a number


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One bar, of one or more pieces."""

    label: str
    pieces: tuple[tuple[float, str], ...]  # size, class
    said: str  # the size in words, at the right
    start: float = 0.0


def curve(
    title: str,
    description: str,
    axes: ChartField,
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
        paths = list(pairwise([*lines[:1], *lines]))
        paths += [] if here is None else [((x, bottom), (x, top))]
        drawn.append(_limit_name(axes, limit, limit_name, paths)[0])
    return chart(title, description, drawn, width=WIDTH, height=axes.height)


def scatter(
    title: str,
    description: str,
    axes: ChartField,
    points: Sequence[ChartPoint],
    *,
    front: Sequence[tuple[float, float]] = (),
    chosen: tuple[float, float] | None = None,
    limit: float | None = None,
    limit_name: str = "",
) -> Element:
    """Return points with their front, the choice and a limit upwards."""
    drawn: list[Element] = [*axes.draw()]
    stairs = _stairs(axes, front) if len(front) > 1 else []
    lines = list(pairwise(stairs))
    taken = [LabelBox.at((axes.x(p.x), axes.y(p.y)), _MARK, _MARK) for p in points]
    words: list[Element] = []
    if chosen is not None:
        x, y = axes.x(chosen[0]), axes.y(chosen[1])
        taken.append(LabelBox.at((x, y), _PICK, _PICK))
        words.append(el("circle", cx=x, cy=y, r=8.0, class_="pick"))
    if limit is not None:
        drawn.append(_limit_line(axes, limit))
        name, box = _limit_name(axes, limit, limit_name, lines, taken)
        words.append(name)
        taken.append(box)
    if stairs:
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in stairs)
        drawn.append(el("polyline", points=path, class_="front"))
    drawn += [*(_point(axes, point) for point in points), *words]
    drawn += _numbers(axes, points, taken)
    return chart(title, description, drawn, width=WIDTH, height=axes.height)


def legend(points: Sequence[ChartPoint]) -> Element:
    """Return the names of a scatter chart's numbered points."""
    return el(
        "ol", [el("li", p.named) for p in points if p.named], class_="key numbers"
    )


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
    scale = AxisScale(low=low, high=max(high, low + max(1e-9, 1e-9 * abs(low))))
    bottom = len(rows) * _ROW + 4
    labels = [_label(row) for row in rows]
    words = [b for k in range(len(rows)) for b in _words(labels[k], rows[k], k * _ROW)]

    def x(value: float) -> float:
        return _LEFT + min(max(scale.share(value), 0.0), 1.0) * (WIDTH - _LEFT - _RIGHT)

    drawn: list[Element] = []
    if band is not None:
        left, wide = x(band[0]), x(band[1]) - x(band[0])
        drawn.append(el("rect", x=left, y=0, width=wide, height=bottom, class_="band"))
    for value in scale.ticks():
        at = x(value)
        drawn += _upright(at, bottom, words, "grid")
        place = "tick mid" if at > 14 else "tick"
        drawn.append(el("text", number(value), x=at, y=bottom + 12, class_=place))
    if unit:
        drawn.append(el("text", unit, x=_LEFT, y=bottom + 24, class_="tick"))
    if limit is not None:
        at = x(limit)
        drawn += _upright(at, bottom, words, "limit")
        said = f"{limit_name} {number(limit)}"
        left = _LEFT + (width(unit, _SMALL) + 8 if unit else 0)
        end = min(max(at + 3, left + width(said, _SIZE)), WIDTH)
        drawn.append(el("text", said, x=end, y=bottom + 24, class_="limit end"))
    for k, row in enumerate(rows):
        drawn += _bar(labels[k], row, k * _ROW, x)
    return chart(title, description, drawn, width=WIDTH, height=bottom + 28)


def _label(row: Bar) -> str:
    """Return a bar's label, cut where its size in words begins."""
    room = WIDTH - _LEFT - _RIGHT - width(visible(row.said), _SMALL) - 2 * _GAP
    return shortened(visible(row.label), _SIZE, room)


def _words(label: str, row: Bar, top: float) -> tuple[LabelBox, LabelBox]:
    """Return the boxes of a bar's label and of its size in words."""
    right, bottom = WIDTH - _RIGHT, top + _LINE
    ends = _LEFT + width(label, _SIZE), right - width(visible(row.said), _SMALL)
    return (
        LabelBox(left=_LEFT, top=top, right=ends[0], bottom=bottom),
        LabelBox(left=ends[1], top=top, right=right, bottom=bottom),
    )


def _upright(
    x: float, bottom: float, words: Sequence[LabelBox], kind: str
) -> list[Element]:
    """Return an upright line, broken where it would run through words."""
    gaps = [w for w in words if w.left - _GAP < x < w.right + _GAP]
    ends = [0.0, *(y for w in gaps for y in (w.top, w.bottom)), bottom]
    pieces = zip(ends[::2], ends[1::2], strict=True)
    return [el("line", x1=x, x2=x, y1=y0, y2=y1, class_=kind)
            for y0, y1 in pieces if y1 > y0]  # fmt: skip


def _bar(
    label: str, row: Bar, top: float, x: Callable[[float], float]
) -> list[Element]:
    """Return one bar with its label above and its size at the right."""
    whole = None if label == visible(row.label) else el("title", row.label)
    drawn = [
        el("text", label, whole, x=_LEFT, y=top + 12),
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


def _limit_ends(axes: ChartField, limit: float) -> Segment:
    """Return where the line of a limit upwards begins and ends."""
    y = axes.y(limit)
    return (axes.x(axes.across.low), y), (axes.x(axes.across.high), y)


def _limit_line(axes: ChartField, limit: float) -> Element:
    """Return the line of a limit upwards."""
    (x0, y), (x1, _) = _limit_ends(axes, limit)
    return el("line", x1=x0, x2=x1, y1=y, y2=y, class_="limit")


def _limit_name(
    axes: ChartField,
    limit: float,
    name: str,
    paths: Sequence[Segment],
    taken: Sequence[LabelBox] = (),
) -> tuple[Element, LabelBox]:
    """Return a limit's name at its line, with its box: where no path crosses it.

    It covers nothing that is `taken` either, as far as possible.
    """
    (x0, y), (x1, _) = _limit_ends(axes, limit)
    wide, share = width(visible(name), _SIZE), axes.up.share(limit)
    sides = [_BELOW] if share > _HIGH else [-_ABOVE]
    if share <= _HIGH and share > 1 - _HIGH:  # room on both sides of the line
        sides = [-_ABOVE, _BELOW]
    spots = [
        LabelBox(left=x, top=y + side - _OVER, right=x + wide, bottom=y + side + _UNDER)
        for side in sides
        for x in (x1 - wide, x0 + 4)
    ]
    free = (
        spot
        for spot in spots
        if not any(map(spot.grown(_GAP).crossed, paths))
        and not any(map(spot.meets, taken))
    )
    box = next(free, spots[0])
    base = box.bottom - _UNDER
    if box.left > x0 + 4:
        return el("text", name, x=x1, y=base, class_="limit end"), box
    return el("text", name, x=box.left, y=base, class_="limit"), box


def _point(axes: ChartField, point: ChartPoint) -> Element:
    """Return a point that shows its name to a pointing device."""
    x, y = axes.x(point.x), axes.y(point.y)
    if point.kind == "cross":
        path = f"M{x - 3.4:.1f} {y - 3.4:.1f}l6.8 6.8m0 -6.8l-6.8 6.8"
        return el("path", el("title", point.label), d=path, class_="cross")
    return el("circle", el("title", point.label), cx=x, cy=y, r=3.8, class_=point.kind)


def _stairs(
    axes: ChartField, front: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the front as stairs: what nothing cheaper is as accurate as."""
    ordered = sorted(front)
    found = [(axes.x(ordered[0][0]), axes.y(ordered[0][1]))]
    for (_, before), (x, y) in pairwise(ordered):
        found += [(axes.x(x), axes.y(before)), (axes.x(x), axes.y(y))]
    return found


def _numbers(
    axes: ChartField, points: Sequence[ChartPoint], taken: Sequence[LabelBox]
) -> list[Element]:
    """Return the numbers of the points that have a name, as `legend` has them."""
    spots = [(axes.x(p.x), axes.y(p.y)) for p in points if p.named]
    size = (width("0" * len(str(len(spots))), _SIZE), _OVER)
    boxes = number_boxes(spots, size=size, mark=_MARK, taken=taken)
    return [
        el("text", str(n), x=(box.left + box.right) / 2, y=box.bottom - 1,
           class_="number mid")
        for n, box in enumerate(boxes, 1)
    ]  # fmt: skip
