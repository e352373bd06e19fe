"""The documented list of extreme points, one by one, and its page."""

import math

import pytest

from tests.optics.extremes.extreme_points import CALLS, Point, points
from tests.optics.extremes.make_extremes import PAGE, page

POINTS = points()


@pytest.mark.parametrize("point", POINTS, ids=[point.name for point in POINTS])
def test_the_value_is_as_expected_without_a_warning(point: Point) -> None:
    found = point.found()
    assert math.isfinite(found)
    assert abs(found - point.expected) <= point.allowed, point.source


def test_every_kind_of_point_is_on_the_list() -> None:
    assert {point.call for point in POINTS} == set(CALLS)
    assert len({point.name for point in POINTS}) == len(POINTS) >= 60


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()


def test_a_wrong_value_is_a_failure() -> None:
    given = {"x": 0.5, "w": 1.0}
    wrong = Point(call="hopkins", given=given, expected=0.5, allowed=1e-3, source="")
    assert not wrong.holds()
    lost = Point(call="table", given=given, expected=0.5, allowed=1.0, source="")
    with pytest.raises(KeyError):  # a mistake in the list is no failed point
        lost.holds()
