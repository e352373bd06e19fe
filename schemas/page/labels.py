"""Where words stand in a picture: names near their points, apart from each other.

Lengths are those of the picture, x to the right and y down.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, permutations

Spot = tuple[float, float]
Segment = tuple[Spot, Spot]

# widths of letters over their size, of the widest face that pages name (DejaVu Sans)
_WIDTHS = {
    letter: share
    for share, letters in (
        (0.32, " ijl.,'\u202f"),
        (0.42, "frtI-()[]/:;|!"),
        (0.7, "ABCKRVXYZ"),
        (0.79, "DGHNOQU&"),
        (0.84, "w<>=+#^~\u00b1\u00d7\u2212"),
        (1.0, "mMW@%\u2026"),
    )
    for letter in letters
}
_ELSE, _WIDEST = 0.64, 1.0
_NEAR = 2.0  # between a mark and its name
_STEP, _STEPS = 6.0, 24  # from a place that is tried to the next one farther off
_JOINED = 6.0  # farther from its mark than that, a name is joined to it by a line
_APART = 2.0  # between names
_UNCLEAR = 6.0  # less than that farther from another named mark: whose name is it?
_CROSSED = 12.0  # a line through a name is as bad as being so much farther off
_TURNS = 16  # directions that are tried, to the right first
_MOST_FIRST, _MOST_ORDERS = 12, 60  # orders in which names are placed
_FEW = 8  # names, of which more orders are tried: there the time is none
_NONE = 1e6  # how bad it is to have no place
_SLANT = 0.3  # of a direction: steeper ones put a name above or below its mark
_SLIDES = (0.0, 0.5, -0.5, 0.9, -0.9)  # and there so much of its half to a side


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """An upright rectangle."""

    left: float
    top: float
    right: float
    bottom: float

    def grown(self, by: float) -> Box:
        """Return the box with so much more on every side."""
        return Box(
            left=self.left - by,
            top=self.top - by,
            right=self.right + by,
            bottom=self.bottom + by,
        )

    def meets(self, other: Box) -> bool:
        """Return whether two boxes overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def holds(self, other: Box) -> bool:
        """Return whether another box lies within."""
        return (
            self.left <= other.left
            and other.right <= self.right
            and self.top <= other.top
            and other.bottom <= self.bottom
        )

    def crossed(self, line: Segment) -> bool:
        """Return whether a line runs through the box (Liang and Barsky 1984)."""
        (x0, y0), (x1, y1) = line
        first, last = 0.0, 1.0
        for way, low, high in (
            (x1 - x0, self.left - x0, self.right - x0),
            (y1 - y0, self.top - y0, self.bottom - y0),
        ):
            if way == 0:
                if not low < 0 < high:
                    return False
                continue
            ends = sorted((low / way, high / way))
            first, last = max(first, ends[0]), min(last, ends[1])
        return first < last

    def nearest(self, spot: Spot) -> Spot:
        """Return the box's point that is nearest to a spot."""
        return (
            min(max(spot[0], self.left), self.right),
            min(max(spot[1], self.top), self.bottom),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PointLabel:
    """The name of a point, which has a mark about it."""

    at: Spot
    width: float
    mark: float  # the mark's radius


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedLabel:
    """Where a name stands; `leader` runs from its mark to it where that is far."""

    box: Box
    leader: Segment | None = None


def width(text: str, size: float) -> float:
    """Return how wide a text of letters of a height is at most, about."""
    return size * sum(map(_letter, text))


def shortened(text: str, size: float, room: float) -> str:
    """Return a text that is no wider than `room`: cut, with an ellipsis if it was."""
    if width(text, size) <= room:
        return text
    left = room - width("\u2026", size)
    kept = 0
    while kept < len(text) and (left := left - size * _letter(text[kept])) >= 0:
        kept += 1
    return text[:kept] + "\u2026"


def placed(
    names: Sequence[PointLabel],
    *,
    height: float,
    field: Box,
    taken: Sequence[Box] = (),
    lines: Sequence[Segment] = (),
) -> list[PlacedLabel | None]:
    """Return where names stand: in the field, on no mark and on no other name.

    Parameters
    ----------
    names : sequence of Name
        Each in turn has the first choice; the order that keeps them nearest counts.
    height : float
        Of a name.
    field : Box
        What names stand in.
    taken : sequence of Box
        What no name may cover: all marks, of points without a name too, and words.
    lines : sequence of Segment
        What names and leaders should rather not cross.

    Returns
    -------
    list of Placed or None
        In the order of `names`; None where there is no room at all.
    """
    options = [
        _options(name, height, field, taken, lines, [n for n in names if n is not name])
        for name in names
    ]
    best: list[PlacedLabel | None] = []
    least, hopeless = math.inf, sum(not own for own in options)
    for k, order in enumerate(_orders(len(names))):
        if k >= min(len(names), _MOST_FIRST) and least < (hopeless + 1) * _NONE:
            break
        found, cost = _in_order([options[n] for n in order])
        if cost < least:
            best, least = [found[order.index(n)] for n in range(len(names))], cost
    return best


def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield each first, the others as they are; then others, in case one has no place.

    The same orders always.
    """
    plain = range(count)
    for first in plain[:_MOST_FIRST]:
        yield first, *(k for k in plain if k != first)
    if count <= _FEW:
        yield from islice(permutations(plain), _MOST_ORDERS)


_Option = tuple[float, PlacedLabel]  # how bad a place is


def _in_order(
    options: Sequence[Sequence[_Option]],
) -> tuple[list[PlacedLabel | None], float]:
    """Return the best place of each name that those before it leave, and the sum."""
    words, leaders, total = list[Box](), list[Segment](), 0.0
    found = list[PlacedLabel | None]()
    for own in options:
        cost, place = next(
            (option for option in own if _free(option[1], words, leaders)),
            (_NONE, None),
        )
        total += cost
        found.append(place)
        if place is not None:
            words.append(place.box.grown(_APART))
            leaders += [] if place.leader is None else [place.leader]
    return found, total


def _free(place: PlacedLabel, words: Sequence[Box], leaders: Sequence[Segment]) -> bool:
    """Return whether neither a name nor its leader meets those that stand there."""
    leader = place.leader
    return not (
        any(map(place.box.meets, words))
        or any(map(place.box.crossed, leaders))
        or (leader is not None and any(word.crossed(leader) for word in words))
    )


def _options(
    name: PointLabel,
    height: float,
    field: Box,
    marks: Sequence[Box],
    lines: Sequence[Segment],
    others: Sequence[PointLabel],
) -> list[_Option]:
    """Return the places of a name that cover no mark, the best first."""
    (x, y), at = name.at, name.mark + 1e-9
    near = Box(left=x - at, top=y - at, right=x + at, bottom=y + at)
    far = [mark for mark in marks if not mark.meets(near)]
    found = list[_Option]()
    for gap, box in _tried(name, height, field):
        if any(map(box.meets, marks)):
            continue
        own = _gap(name, box) + _UNCLEAR
        unclear = any(_gap(other, box) < own for other in others)
        leader = _leader(name, box) if gap > _JOINED or unclear else None
        if leader is not None and any(mark.crossed(leader) for mark in far):
            continue
        cost = gap + _CROSSED * sum(map(box.crossed, lines))
        cost += _UNCLEAR if unclear else 0.0
        found.append((cost, PlacedLabel(box=box, leader=leader)))
    return sorted(found, key=lambda option: option[0])


def _tried(name: PointLabel, height: float, field: Box) -> Iterator[tuple[float, Box]]:
    """Yield gaps and boxes in the field about a mark, from near to far."""
    (x, y), wide, tall = name.at, name.width, height
    if wide > field.right - field.left or tall > field.bottom - field.top:
        return
    for k in range(_STEPS):
        gap = _NEAR + k * _STEP
        for turn in range(_TURNS):
            angle = _angle(turn)
            c, s = math.cos(angle), math.sin(angle)
            top = y + s * (name.mark + gap) + (_side(s) - 1) * tall / 2
            for side in (_side(c),) if _side(c) else _SLIDES:
                left = x + c * (name.mark + gap) + (side - 1) * wide / 2
                box = Box(left=left, top=top, right=left + wide, bottom=top + tall)
                if field.holds(box):
                    yield gap, box


def _angle(turn: int) -> float:
    """Return a direction: to the right, a little down, a little up, and so on."""
    return (turn + 1) // 2 * (math.tau / _TURNS) * (1 if turn % 2 else -1)


def _side(share: float) -> int:
    """Return on which side of a mark a name lies, 0 for neither."""
    return 0 if abs(share) < _SLANT else int(math.copysign(1, share))


def _gap(name: PointLabel, box: Box) -> float:
    """Return how far a mark's rim is from a box."""
    (x, y), (u, v) = name.at, box.nearest(name.at)
    return math.hypot(u - x, v - y) - name.mark


def _leader(name: PointLabel, box: Box) -> Segment:
    """Return the line from a mark's rim to the nearest point of a name's box."""
    (x, y), (u, v) = name.at, box.nearest(name.at)
    far = math.hypot(u - x, v - y) or 1.0
    return (x + (u - x) * name.mark / far, y + (v - y) * name.mark / far), (u, v)


def _letter(letter: str) -> float:
    """Return a letter's width over its height, at most."""
    if unicodedata.east_asian_width(letter) in ("W", "F"):
        return _WIDEST
    return _WIDTHS.get(letter, _ELSE)
