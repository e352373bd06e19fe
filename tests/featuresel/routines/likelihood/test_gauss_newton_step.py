from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.routines.contract import Failure, Guess, Measurement
from microplan.featuresel.routines.likelihood.likelihood import ONE_STEP
from tests.featuresel.fits import artifact, case, draw, photo, render


@pytest.mark.parametrize("name", ["find_gear", "post"])
@pytest.mark.parametrize("z_um", [0.0, 4.0, 10.0])
def test_a_guess_a_tenth_of_a_pixel_off_is_mended_to_a_thousandth(
    name: str, z_um: float
) -> None:
    rng = np.random.default_rng(12)
    for angle in (0.4, 2.5, 4.6):
        drawn = draw(name, rng, z_um=z_um)
        pose, theta = drawn.pose(case(name)), case(name).theta_rad + drawn.theta_rad
        guess = Guess(
            column=pose.column + 0.1 * math.cos(angle),
            row=pose.row + 0.1 * math.sin(angle),
            theta_rad=theta,
            z_um=z_um,
            zoom=1.0,
        )
        found = ONE_STEP.measure(drawn.render(render(name)), artifact(name), guess)
        assert isinstance(found, Measurement)
        assert math.hypot(found.column - pose.column, found.row - pose.row) < 1e-3


def test_a_guess_too_far_off_is_refused() -> None:
    rng = np.random.default_rng(13)
    for off_px in (1.0, 2.0):
        drawn = draw("find_gear", rng)
        pose = drawn.pose(case("find_gear"))
        guess = Guess(
            column=pose.column + off_px, row=pose.row,
            theta_rad=case("find_gear").theta_rad + drawn.theta_rad, z_um=0.0,
        )  # fmt: skip
        image = photo("find_gear", drawn, rng)
        found = ONE_STEP.measure(image, artifact("find_gear"), guess)
        assert isinstance(found, Failure)
        assert found.code in ("not_captured", "misfit")


def test_a_guess_without_focus_is_refused() -> None:
    image = render("post")()
    guess = Guess(column=99.7, row=99.6)
    found = ONE_STEP.measure(image, artifact("post"), guess)
    assert isinstance(found, Failure)
    assert found.code == "no_focus"
    known = ONE_STEP.measure(image, artifact("post"), replace(guess, z_um=0.0))
    assert isinstance(known, Measurement)


@pytest.mark.parametrize("value", [0.0, 0.4, 1.0])
def test_an_image_of_nothing_is_refused(value: float) -> None:
    guess = Guess(column=99.7, row=99.6, z_um=0.0)
    for shape in ((200, 200), (8, 8), (1, 1)):
        image = np.full(shape, value)
        image.setflags(write=False)
        assert isinstance(ONE_STEP.measure(image, artifact("post"), guess), Failure)
