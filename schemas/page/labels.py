"""Boxes of words in charts: width of text, free boxes for numbers.

Lengths are those of the picture, x to the right and y down.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from microplan.arrays import Point

Segment = tuple[Point, Point]

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
_GAPS = (1.0, 7.0, 14.0, 21.0, 28.0, 35.0)  # between a mark and its number, tried so
_DIRECTIONS = (
    (0, -1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (1, 1), (-1, 1),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelBox:
    """An upright rectangle."""

    left: float
    top: float
    right: float
    bottom: float

    @classmethod
    def at(cls, center: Point, half_width: float, half_height: float) -> Self:
        """Return the box about a point."""
        x, y = center
        return cls(
            left=x - half_width,
            top=y - half_height,
            right=x + half_width,
            bottom=y + half_height,
        )

    def grown(self, by: float) -> LabelBox:
        """Return the box with so much more on every side."""
        return LabelBox(
            left=self.left - by,
            top=self.top - by,
            right=self.right + by,
            bottom=self.bottom + by,
        )

    def meets(self, other: LabelBox) -> bool:
        """Return whether two boxes overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def crossed(self, line: Segment) -> bool:
        """Return whether a line runs through the box (Liang and Barsky 1984)."""
        (x0, y0), (x1, y1) = line
        first, last = 0.0, 1.0
        for step, low, high in (
            (x1 - x0, self.left - x0, self.right - x0),
            (y1 - y0, self.top - y0, self.bottom - y0),
        ):
            if step == 0:
                if not low < 0 < high:
                    return False
                continue
            ends = sorted((low / step, high / step))
            first, last = max(first, ends[0]), min(last, ends[1])
        return first < last


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


def number_boxes(
    spots: Sequence[Point],
    *,
    size: tuple[float, float],
    mark: float,
    taken: Sequence[LabelBox] = (),
) -> list[LabelBox]:
    """Return a box for the number of each point, on no mark and on no other number.

    Parameters
    ----------
    spots : sequence of Point
        Centres of the numbered marks.
    size : (width, height)
        Of a number.
    mark : float
        Radius of a mark.
    taken : sequence of LabelBox
        Further words and marks that no number may cover.

    Returns
    -------
    list of LabelBox
        The nearest free box of each; above its mark where none is free.
    """
    wide, tall = size[0] / 2, size[1] / 2
    used = [*taken, *(LabelBox.at(spot, mark, mark) for spot in spots)]
    found = list[LabelBox]()
    for x, y in spots:
        tried = [
            LabelBox.at((x + u * (mark + wide + gap), y + v * (mark + tall + gap)),
                        wide, tall)
            for gap in _GAPS
            for u, v in _DIRECTIONS
        ]  # fmt: skip
        box = next((b for b in tried if not any(map(b.meets, used))), tried[0])
        found.append(box)
        used.append(box)
    return found


def _letter(letter: str) -> float:
    """Return a letter's width over its height, at most."""
    if unicodedata.east_asian_width(letter) in ("W", "F"):
        return _WIDEST
    return _WIDTHS.get(letter, _ELSE)
