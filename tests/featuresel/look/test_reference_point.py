"""A measurement in pixels to the target's place and angle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located, along, located
from microplan.featuresel.routines.contract import Failure, Measurement

Look = Callable[[str], LookCase]

NUMBERS = [field.name for field in fields(Measurement) if field.type != "bool"]


def measured(case: LookCase, x: float, y: float, **more: Any) -> Measurement:
    column, row = case.frame.to_pixel(x, y)
    form: dict[str, Any] = {"theta_rad": None} | more
    return Measurement(column=column, row=row, score=1.0, spread_px=0.01, **form)


@pytest.mark.parametrize("turned", [0.0, 1.3, -3.0])
def test_the_angle_is_the_looks_however_the_target_is_turned_in_it(
    turned: float, look: Look
) -> None:
    case = look("post")
    target = replace(case.target, theta_rad=case.theta_rad + turned)
    case = replace(case, target=target)
    place = located(case, measured(case, 1.0, 2.0, theta_rad=0.7 + turned))
    assert isinstance(place, Located)
    assert (place.x_um, place.y_um) == pytest.approx((1, 2))
    assert place.theta_rad == pytest.approx(0.7)


def test_what_was_not_measured_is_not_told(look: Look) -> None:
    case = look("post")
    place = located(case, measured(case, 1.0, 2.0, axis_rad=0.4))
    assert isinstance(place, Located)
    assert (place.theta_rad, place.axis_rad) == (None, 0.4)


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize("name", NUMBERS)
def test_an_answer_that_is_no_number_is_none(
    name: str, number: float, look: Look
) -> None:
    case = look("post")
    form: dict[str, Any] = {name: number}
    answer = replace(measured(case, 0.0, 0.0), **form)
    found = located(case, answer)
    assert isinstance(found, Failure)
    assert found.code == "not_finite"
    assert name in found.message


def test_only_the_part_along_the_known_direction_counts() -> None:
    assert along((3.0, 4.0), None) == (3.0, 4.0)
    assert along((3.0, 4.0), 0.0) == pytest.approx((3.0, 0.0))
    assert along((3.0, 4.0), math.pi / 2) == pytest.approx((0.0, 4.0))
    assert along((3.0, 4.0), math.atan2(4, 3)) == pytest.approx((3.0, 4.0))
