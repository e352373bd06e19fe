"""Names in pictures: near their marks, and nothing on anything else."""

from __future__ import annotations

import math
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.font_manager import findfont
from matplotlib.ft2font import FT2Font

from microplan.schemas.page.labels import (
    Box,
    PointLabel,
    Segment,
    placed,
    shortened,
    width,
)

FIELD = Box(left=0.0, top=0.0, right=360.0, bottom=200.0)
MARK, HEIGHT = 4.0, 14.0
SPOTS = st.tuples(st.floats(10, 350), st.floats(10, 190))


def about(spot: tuple[float, float]) -> Box:
    """Return the box about a mark."""
    return Box(left=spot[0], top=spot[1], right=spot[0], bottom=spot[1]).grown(MARK)


def runs_through(line: Segment, box: Box) -> bool:
    """Return whether one of many points of a line lies within a box."""
    (x0, y0), (x1, y1) = line
    return any(
        box.left < x0 + s * (x1 - x0) < box.right
        and box.top < y0 + s * (y1 - y0) < box.bottom
        for s in (k / 199 for k in range(200))
    )


@settings(max_examples=40)
@given(
    spots=st.lists(SPOTS, min_size=1, max_size=5),
    wide=st.floats(5, 90),
)
def test_names_lie_on_no_mark_and_on_no_other_name(
    spots: list[tuple[float, float]], wide: float
) -> None:
    names = [PointLabel(at=spot, width=wide, mark=MARK) for spot in spots]
    marks = [about(spot) for spot in spots]
    found = placed(names, height=HEIGHT, field=FIELD, taken=marks)
    boxes = [place.box for place in found if place is not None]
    assert boxes  # marks in one place may leave room for fewer names than there are
    assert not any(a.meets(b) for a, b in combinations(boxes, 2))
    assert not any(box.meets(mark) for box in boxes for mark in marks)
    for box in boxes:
        assert box.right - box.left == pytest.approx(wide)
        assert FIELD.left <= box.left <= box.right <= FIELD.right
        assert FIELD.top <= box.top <= box.bottom <= FIELD.bottom
    for place, name in zip(found, names, strict=True):
        if place is None:
            continue
        near = place.box.nearest(name.at)
        far = math.dist(near, name.at) - MARK
        assert far < 8 or place.leader is not None
        if place.leader is not None:
            assert place.leader[1] == near
            assert math.dist(place.leader[0], name.at) == pytest.approx(MARK)
            assert not any(runs_through(place.leader, box) for box in boxes)


def test_a_lone_name_stands_right_beside_its_mark() -> None:
    (place,) = placed(
        [PointLabel(at=(100.0, 100.0), width=40.0, mark=MARK)],
        height=HEIGHT,
        field=FIELD,
    )
    assert place is not None
    assert place.leader is None
    assert (place.box.left, place.box.top) == pytest.approx((106.0, 93.0))


def test_a_name_gives_way_to_a_line_where_it_can() -> None:
    name = PointLabel(at=(100.0, 100.0), width=40.0, mark=MARK)
    line = ((100.0, 100.0), (300.0, 100.0))  # where it would stand
    (place,) = placed([name], height=HEIGHT, field=FIELD, lines=[line])
    assert place is not None
    assert place.leader is None
    assert not runs_through(line, place.box)


def test_where_there_is_no_room_there_is_no_name() -> None:
    name = PointLabel(at=(100.0, 100.0), width=400.0, mark=MARK)
    assert placed([name], height=HEIGHT, field=FIELD) == [None]
    small = PointLabel(at=(100.0, 100.0), width=40.0, mark=MARK)
    assert placed([small], height=HEIGHT, field=FIELD, taken=[FIELD]) == [None]
    assert placed([], height=HEIGHT, field=FIELD) == []


@given(ends=st.tuples(SPOTS, SPOTS))
def test_a_box_is_crossed_where_points_of_the_line_are_in_it(
    ends: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    box = Box(left=120.0, top=60.0, right=200.0, bottom=110.0)
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
