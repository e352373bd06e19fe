"""Places that a user states."""

from __future__ import annotations

import math

import pytest

from microplan.planner.measure.near import parse_near


def test_a_place_in_pixels_has_column_and_row() -> None:
    near = parse_near("320px, 244.5px")
    assert (near.x, near.y, near.unit, near.theta_rad) == (320, 244.5, "px", None)


def test_a_place_in_the_world_may_have_an_angle_in_degrees() -> None:
    near = parse_near("-12um,3um,90")
    assert (near.x, near.y, near.unit) == (-12, 3, "um")
    assert near.theta_rad == math.pi / 2


@pytest.mark.parametrize(
    "text", ["", "1px", "1,2", "1px,2um", "nanpx,2px", "1px,2px,inf", "1px,2px,3,4"]
)
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - float's own words, or the text
        parse_near(text)
