"""A feature's measured place to that of the look's reference point."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace

import pytest

from featuresel.case import LookCase
from featuresel.located import Located, along, located
from featuresel.perturb import Trial, design, image
from featuresel.routines import Failure, Measurement
from featuresel.trials import measure_picture, prepare
from optics.outline import place as put

Look = Callable[[str], LookCase]
OFFSET = (12.0, -5.0)


def measured(case: LookCase, x: float, y: float, **more: float | None) -> Measurement:
    column, row = case.frame.to_pixel(x, y)
    form = {"theta_rad": None} | more
    return Measurement(column=column, row=row, score=1.0, spread_px=0.01, **form)


def feature(case: LookCase, turned_rad: float = 0.0) -> LookCase:
    """Return the look with a feature off its reference point, turned against it."""
    theta = case.theta_rad + turned_rad
    return replace(case, target=replace(case.target, offset_um=OFFSET, theta_rad=theta))


def sure(found: Located | Failure) -> Located:
    assert isinstance(found, Located)
    return found


@pytest.mark.parametrize("turned", [0.0, 1.3])
def test_the_reference_point_is_an_offset_away(turned: float, look: Look) -> None:
    case, theta = feature(look("post"), turned), 0.7
    # the feature as seen of a part at (1, 2) um, turned by theta: by complex numbers
    seen = complex(1, 2) + complex(*OFFSET) * complex(math.cos(theta), math.sin(theta))
    place = sure(
        located(case, measured(case, seen.real, seen.imag, theta_rad=theta + turned))
    )
    assert (place.x_um, place.y_um) == pytest.approx((1, 2))
    assert place.theta_rad == pytest.approx(theta)


def test_without_an_angle_the_nominal_one_is_taken_if_there_is_one(look: Look) -> None:
    case = feature(look("post"))  # nominally turned by .1
    seen = complex(1, 2) + complex(*OFFSET) * complex(math.cos(0.1), math.sin(0.1))
    place = sure(located(case, measured(case, seen.real, seen.imag)))
    assert (place.x_um, place.y_um) == pytest.approx((1, 2))
    assert place.theta_rad is None
    lost = located(replace(case, theta_any=True), measured(case, 0.0, 0.0))
    assert isinstance(lost, Failure)
    assert lost.code == "no_angle"


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize("name", [field.name for field in fields(Measurement)])
def test_an_answer_that_is_no_number_is_none(
    name: str, number: float, look: Look
) -> None:
    case = look("post")
    answer = replace(measured(case, 0.0, 0.0), **{name: number})
    found = located(case, answer)
    assert isinstance(found, Failure)
    assert found.code == "not_finite"
    assert name in found.message


def test_only_the_part_along_the_known_direction_counts() -> None:
    assert along((3.0, 4.0), None) == (3.0, 4.0)
    assert along((3.0, 4.0), 0.0) == pytest.approx((3.0, 0.0))
    assert along((3.0, 4.0), math.pi / 2) == pytest.approx((0.0, 4.0))
    assert along((3.0, 4.0), math.atan2(4, 3)) == pytest.approx((3.0, 4.0))


def _at_rest(case: LookCase) -> Trial:
    return replace(
        design(case, 1, 1)[0], dx_um=1.5, dy_um=-0.5, dtheta_rad=0.05, dz_um=0.0,
        magnification=1.0, gain=1.0, gradient_x=0.0, gradient_y=0.0,
    )  # fmt: skip


def test_a_bore_off_the_origin_tells_where_its_part_is(look: Look) -> None:
    """The post's layer moved in its part: the same image, another reference point."""
    case = look("post")
    moved = tuple(
        replace(layer, outline=put(layer.outline, 3.0, 1.0, 0.0))
        for layer in case.moving
    )
    c, s = math.cos(case.theta_rad), math.sin(case.theta_rad)
    column, row = case.frame.to_pixel(case.x_um + 3 * c - s, case.y_um + 3 * s + c)
    target = replace(case.target, column=column, row=row, offset_um=(3.0, 1.0))
    case = replace(case, moving=moved, target=target)
    ready = prepare(case, [("circle_caliper",)])
    trial = _at_rest(case)
    (found,) = measure_picture(case, ready, trial, image(case, trial))
    # a circle has no angle: the part's turn of .05 moves its bore sqrt(10) x .05 um
    assert found.distance_um == pytest.approx(0.05 * math.sqrt(10), abs=0.03)
    straight = replace(trial, dtheta_rad=0.0)
    (found,) = measure_picture(case, ready, straight, image(case, straight))
    assert found.distance_um < 0.03
