"""Boxes of words in charts: numbers are near their marks and cover nothing."""

from __future__ import annotations

from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.font_manager import findfont
from matplotlib.ft2font import FT2Font

from microplan.schemas.page.labels import (
    LabelBox,
    Segment,
    number_boxes,
    shortened,
    width,
)

MARK, SIZE = 4.0, (8.0, 11.0)  # radius of a mark, width and height of a number
SPOTS = st.tuples(st.floats(10, 350), st.floats(10, 190))


def runs_through(line: Segment, box: LabelBox) -> bool:
    """Return whether one of many points of a line lies within a box."""
    (x0, y0), (x1, y1) = line
    return any(
        box.left < x0 + s * (x1 - x0) < box.right
        and box.top < y0 + s * (y1 - y0) < box.bottom
        for s in (k / 199 for k in range(200))
    )


@settings(max_examples=40)
@given(spots=st.lists(SPOTS, min_size=1, max_size=5))
def test_numbers_lie_on_no_mark_and_on_no_other_number(
    spots: list[tuple[float, float]],
) -> None:
    marks = [LabelBox.at(spot, MARK, MARK) for spot in spots]
    word = LabelBox.at((180.0, 100.0), 30.0, 7.0)
    boxes = number_boxes(spots, size=SIZE, mark=MARK, taken=[word])
    assert not any(a.meets(b) for a, b in combinations(boxes, 2))
    assert not any(box.meets(other) for box in boxes for other in [*marks, word])
    for box in boxes:
        assert (box.right - box.left, box.bottom - box.top) == pytest.approx(SIZE)


def test_a_lone_number_is_right_above_its_mark() -> None:
    (box,) = number_boxes([(100.0, 100.0)], size=SIZE, mark=MARK)
    assert (box.left + box.right) / 2 == pytest.approx(100.0)
    assert box.bottom == pytest.approx(100.0 - MARK - 1.0)


def test_where_nothing_is_free_a_number_is_above_its_mark_all_the_same() -> None:
    full = LabelBox(left=0.0, top=0.0, right=360.0, bottom=200.0)
    spots = [(100.0, 100.0)]
    assert number_boxes(spots, size=SIZE, mark=MARK, taken=[full]) == number_boxes(
        spots, size=SIZE, mark=MARK
    )
    assert number_boxes([], size=SIZE, mark=MARK) == []


@given(ends=st.tuples(SPOTS, SPOTS))
def test_a_box_is_crossed_where_points_of_the_line_are_in_it(
    ends: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    box = LabelBox(left=120.0, top=60.0, right=200.0, bottom=110.0)
    if runs_through(ends, box):
        assert box.crossed(ends)
    if box.crossed(ends):  # by less than the points of a line are apart, maybe
        assert runs_through(ends, box.grown(2.0))


def test_no_letter_is_wider_than_it_is_taken_for() -> None:
    """By the metrics of the face itself, which matplotlib brings."""
    face = FT2Font(findfont("DejaVu Sans"))
    face.set_size(100, 72)  # pixels
    for letter in [*map(chr, range(32, 127)), *"\u00b0\u00b1\u00b5\u00d7\u2212\u2026"]:
        own = face.load_char(ord(letter)).linearHoriAdvance / 65536
        assert own <= width(letter, 100), letter


@settings(max_examples=50)
@given(text=st.text(max_size=30), room=st.floats(11, 300))
def test_what_is_cut_has_its_room(text: str, room: float) -> None:
    found = shortened(text, 11, room)
    assert width(found, 11) <= room + 1e-9
    assert found == text or text.startswith(found.removesuffix("\u2026"))
    assert (found == text) == (width(text, 11) <= room) or text.endswith("\u2026")
