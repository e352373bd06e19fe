"""Where words stand in a picture: names near their points, apart from each other.

Lengths are those of the picture, x to the right and y down.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

Spot = tuple[float, float]
Segment = tuple[Spot, Spot]

# widths of letters over their height, of the widest face that pages name (DejaVu Sans)
_WIDTHS = {
    letter: share
    for share, letters in (
        (0.32, " ijl.,:;'|!\u202f"),
        (0.42, 'frtI-()[]/"'),
        (0.7, "ABCDGHKNOQRUVXY&"),
        (0.84, "w<>=+\u00d7\u2212"),
        (1.0, "mMW@%\u2026"),
    )
    for letter in letters
}
_ELSE, _WIDEST = 0.64, 1.0
_NEAR = 2.0  # between a mark and its name
_STEP = 6.0  # from a place that is tried to the next one farther off
_JOINED = 6.0  # farther from its mark than that, a name is joined to it by a line
_APART = 2.0  # between names
_UNCLEAR = 6.0  # less than that farther from another named mark: whose name is it?
_CROSSED = 12.0  # a line through a name is as bad as being so much farther off
_TURNS = 16  # directions that are tried, to the right first
_MOST_ORDERS = 12  # in which names are placed
_NONE = 1e6  # how bad it is to have no place
_SLANT = 0.3  # of a direction: steeper ones put a name above or below, in its middle


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
class Name:
    """The name of a point, which has a mark about it."""

    at: Spot
    width: float
    mark: float  # the mark's radius


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
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
    names: Sequence[Name],
    *,
    height: float,
    field: Box,
    taken: Sequence[Box] = (),
    lines: Sequence[Segment] = (),
) -> list[Placed | None]:
    """Return where names stand: in the field, on no mark and on no other name.

    Parameters
    ----------
    names : sequence of Name
        Each in turn has the first choice; the order that keeps them nearest counts.
    height : float
        Of a name.
    taken : sequence of Box
        What no name may cover: all marks, of points without a name too, and words.
    lines : sequence of Segment
        What names and leaders should rather not cross.

    Returns
    -------
    list of Placed or None
        In the order of `names`; None where there is no room at all.
    """
    best: list[_Found] = []
    for first in range(min(len(names), _MOST_ORDERS)):
        order = [first, *(k for k in range(len(names)) if k != first)]
        found = _in_order([names[k] for k in order], height, field, taken, lines)
        if not best or _total(found) < _total(best):
            best = [found[order.index(k)] for k in range(len(names))]
    return [place for place, _ in best]


_Found = tuple[Placed | None, float]  # and how bad it is


def _total(found: Sequence[_Found]) -> float:
    return sum(cost for _, cost in found)


def _in_order(
    names: Sequence[Name],
    height: float,
    field: Box,
    marks: Sequence[Box],
    lines: Sequence[Segment],
) -> list[_Found]:
    """Return the places of names, each the best that those before it leave."""
    words, leaders, found = list[Box](), list[Segment](), list[_Found]()
    for name in names:
        others = [other for other in names if other is not name]
        free = _Free(field=field, marks=marks, words=words, leaders=leaders,
                     lines=lines, others=others)  # fmt: skip
        place, cost = _nearest(name, height, free)
        found.append((place, cost))
        if place is not None:
            words.append(place.box.grown(_APART))
            leaders += [] if place.leader is None else [place.leader]
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Free:
    """What a name must and should keep off."""

    field: Box
    marks: Sequence[Box]
    words: Sequence[Box]
    leaders: Sequence[Segment]
    lines: Sequence[Segment]
    others: Sequence[Name]

    def bears(self, name: Name, box: Box, leader: Segment | None) -> bool:
        """Return whether a name covers nothing there, and its leader no words."""
        taken = (*self.marks, *self.words)
        if any(map(box.meets, taken)) or any(map(box.crossed, self.leaders)):
            return False
        if leader is None:
            return True
        (x, y), at = name.at, name.mark + 1e-9
        near = Box(left=x - at, top=y - at, right=x + at, bottom=y + at)
        far = (*(mark for mark in self.marks if not mark.meets(near)), *self.words)
        return not any(box.crossed(leader) for box in far)

    def unclear(self, name: Name, box: Box) -> bool:
        """Return whether it might be taken for the name of another mark."""
        return any(
            _gap(other, box) < _gap(name, box) + _UNCLEAR for other in self.others
        )


def _nearest(name: Name, height: float, free: _Free) -> _Found:
    """Return the best place of one name: near, with as few lines through it as can be.

    Places are tried from near to far, and no farther than could still be better.
    """
    best, least = None, _NONE
    for gap, box in _tried(name, height, free.field):
        if gap >= least:
            break
        unclear = free.unclear(name, box)
        leader = _leader(name, box) if gap > _JOINED or unclear else None
        if not free.bears(name, box, leader):
            continue
        cost = gap + _CROSSED * sum(map(box.crossed, free.lines))
        cost += _UNCLEAR if unclear else 0.0
        if cost < least:
            best, least = Placed(box=box, leader=leader), cost
    return best, least


def _tried(name: Name, height: float, field: Box) -> Iterator[tuple[float, Box]]:
    """Yield gaps and boxes in the field about a mark, from near to far."""
    (x, y), wide, tall = name.at, name.width, height
    across = field.right - field.left + field.bottom - field.top
    for k in range(math.ceil(across / _STEP)):
        gap = _NEAR + k * _STEP
        for turn in range(_TURNS):
            angle = _angle(turn)
            c, s = math.cos(angle), math.sin(angle)
            left = x + c * (name.mark + gap) + (_side(c) - 1) * wide / 2
            top = y + s * (name.mark + gap) + (_side(s) - 1) * tall / 2
            box = Box(left=left, top=top, right=left + wide, bottom=top + tall)
            if field.holds(box):
                yield gap, box


def _angle(turn: int) -> float:
    """Return a direction: to the right, a little down, a little up, and so on."""
    return (turn + 1) // 2 * (math.tau / _TURNS) * (1 if turn % 2 else -1)


def _side(share: float) -> int:
    """Return on which side of a mark a name lies, 0 for neither."""
    return 0 if abs(share) < _SLANT else int(math.copysign(1, share))


def _gap(name: Name, box: Box) -> float:
    """Return how far a mark's rim is from a box."""
    (x, y), (u, v) = name.at, box.nearest(name.at)
    return math.hypot(u - x, v - y) - name.mark


def _leader(name: Name, box: Box) -> Segment:
    """Return the line from a mark's rim to the nearest point of a name's box."""
    (x, y), (u, v) = name.at, box.nearest(name.at)
    far = math.hypot(u - x, v - y) or 1.0
    return (x + (u - x) * name.mark / far, y + (v - y) * name.mark / far), (u, v)


def _letter(letter: str) -> float:
    """Return a letter's width over its height, at most."""
    if unicodedata.east_asian_width(letter) in ("W", "F"):
        return _WIDEST
    return _WIDTHS.get(letter, _ELSE)
