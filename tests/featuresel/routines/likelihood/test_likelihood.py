"""The likeliest pose by the routine: its whole range, and what is not the target."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import NominalRender, nominal_render
from microplan.featuresel.routines.contract import Failure, Guess, Measurement
from microplan.featuresel.routines.likelihood import likelihood
from microplan.featuresel.routines.likelihood.pose_start import other_turns
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from tests.featuresel.conftest import TEETH, disc, gear, noisy
from tests.featuresel.fits import Drawn, artifact, case, draw, near, photo, render

# Ten times the limits 10 um out of focus, .004 px and .06 mrad; a wrong tooth is .35
# rad off, a wrong half tooth .17.
PLACE_PX = 0.04
TURN_RAD = 6e-4
FAR_TURN_RAD = 2e-3  # five times the limit at 25 um


def measure(name: str, image: FloatArray, guess: Guess) -> Measurement | Failure:
    return likelihood.measure(image, artifact(name), guess)


def off(name: str, drawn: Drawn, found: Measurement | Failure) -> tuple[float, float]:
    """Return what place, px, and turn, rad, are off by."""
    assert isinstance(found, Measurement), found
    pose = drawn.pose(case(name))
    away = math.hypot(found.column - pose.column, found.row - pose.row)
    if found.theta_rad is None:
        return away, 0.0
    turn = found.theta_rad - case(name).theta_rad - drawn.theta_rad
    return away, abs(math.remainder(turn, math.tau))


def around(name: str, drawn: Drawn, away_px: float, angle: float) -> Guess:
    return near(
        drawn.pose(case(name)),
        column=away_px * math.cos(angle),
        row=away_px * math.sin(angle),
    )


@pytest.mark.parametrize("name", ["find_gear", "post", "over_shaft"])
def test_a_start_within_a_pixel_and_a_half_finds_the_place(name: str) -> None:
    rng = np.random.default_rng(31)
    for k in range(8):
        drawn = draw(name, rng, z_um=1.4 * k)
        guess = around(name, drawn, 1.5, rng.uniform(0, math.tau))
        place, turn = off(name, drawn, measure(name, photo(name, drawn, rng), guess))
        assert place < PLACE_PX
        assert turn < TURN_RAD


@pytest.mark.parametrize(
    ("name", "z_um"), [("find_gear", 0.0), ("find_gear", 10.0), ("far_gear", 1.0)]
)
def test_a_gears_angle_is_found_from_none(name: str, z_um: float) -> None:
    rng = np.random.default_rng(32)
    for turn in np.linspace(-math.pi, math.pi, 9, endpoint=False) + 0.05:
        drawn = replace(draw(name, rng, z_um=z_um), theta_rad=float(turn))
        guess = around(name, drawn, 0.7, rng.uniform(0, math.tau))
        found = measure(name, photo(name, drawn, rng), guess)
        assert max(off(name, drawn, found)) < PLACE_PX
        most = FAR_TURN_RAD if name == "far_gear" else TURN_RAD
        assert off(name, drawn, found)[1] < most


@pytest.mark.parametrize("teeth", [1, -4, 9, 0.5])
def test_a_wrong_tooth_is_mended(teeth: float) -> None:
    rng = np.random.default_rng(33)
    drawn = draw("find_gear", rng)
    theta = case("find_gear").theta_rad + drawn.theta_rad + teeth * math.tau / TEETH
    guess = replace(around("find_gear", drawn, 0.3, 1.0), theta_rad=theta)
    found = measure("find_gear", photo("find_gear", drawn, rng), guess)
    assert off("find_gear", drawn, found)[1] < TURN_RAD


def test_a_wrong_tooth_is_mended_in_levels_that_nobody_stated() -> None:
    rng = np.random.default_rng(33)
    drawn = draw("find_gear", rng)
    theta = case("find_gear").theta_rad + drawn.theta_rad + 4 * math.tau / TEETH
    guess = replace(around("find_gear", drawn, 0.3, 1.0), theta_rad=theta)
    light = np.maximum(drawn.render(render("find_gear")), 0.0)
    image = noisy(case("find_gear"), 1.1 * light**1.5 - 0.05, rng)
    found = measure("find_gear", image, guess)
    place, turn = off("find_gear", drawn, found)
    assert place < PLACE_PX
    assert turn < TURN_RAD


@pytest.mark.parametrize("z_um", [-9.0, 9.0])
def test_what_stands_in_front_tells_the_side_of_focus(z_um: float) -> None:
    # the gear alone looks the same on both sides, the fingers 130 um above do not
    rng = np.random.default_rng(38)
    for _ in range(3):
        drawn = draw("between", rng, z_um=z_um)
        guess = around("between", drawn, 0.7, rng.uniform(0, math.tau))
        found = measure("between", photo("between", drawn, rng), guess)
        assert max(off("between", drawn, found)) < PLACE_PX
        assert isinstance(found, Measurement)
        assert found.z_um == pytest.approx(z_um, abs=0.2)


@pytest.mark.parametrize("z_um", [4.0, -6.0, 8.0])
def test_a_bent_response_does_not_turn_the_side_of_focus(z_um: float) -> None:
    rng = np.random.default_rng(39)
    drawn = draw("between", rng, z_um=z_um)
    light = np.maximum(drawn.render(render("between")), 0.0) ** 0.6
    guess = replace(around("between", drawn, 0.3, 1.0), z_um=z_um)
    found = measure("between", noisy(case("between"), light, rng), guess)
    assert max(off("between", drawn, found)) < PLACE_PX
    assert isinstance(found, Measurement)
    assert found.z_um == pytest.approx(z_um, abs=0.5)


@pytest.mark.parametrize("bend", [(0.5, 0.05, -0.6), (0.2, 0.5, -0.6), (0.1, 2, -2)])
def test_light_that_falls_where_more_is_expected_is_another_thing(
    bend: tuple[float, float, float],
) -> None:
    rng = np.random.default_rng(40)
    drawn = draw("find_gear", rng)
    light = drawn.render(render("find_gear"))
    odd = bend[0] + bend[1] * light + bend[2] * light**2
    image = noisy(case("find_gear"), odd, rng)
    found = measure("find_gear", image, around("find_gear", drawn, 0.3, 1.0))
    assert isinstance(found, Failure) or found.score < 0.1


def test_an_overexposed_target_is_found_by_the_edges_that_are_left() -> None:
    rng = np.random.default_rng(41)
    drawn = draw("find_gear", rng)
    bright = 1.9 * drawn.render(render("find_gear"))
    image = noisy(case("find_gear"), np.minimum(bright, 1.0), rng)
    found = measure("find_gear", image, around("find_gear", drawn, 0.3, 1.0))
    assert max(off("find_gear", drawn, found)) < PLACE_PX


def without_notch(_drawn: Drawn) -> NominalRender:
    shown = case("find_gear")
    plain = replace(shown.moving[0], outline=gear(notch=False))
    return nominal_render(replace(shown, moving=(plain,)))


def with_lid(drawn: Drawn) -> NominalRender:
    """Return the gear with its notch under something nobody knows of."""
    shown = case("find_gear")
    angle = shown.theta_rad + drawn.theta_rad + math.pi / 2
    x = shown.x_um + drawn.dx_um + 27.5 * math.cos(angle)
    y = shown.y_um + drawn.dy_um + 27.5 * math.sin(angle)
    lid = Layer(
        name="lid", outline=Outline(rings=(disc(8, x, y),)), z_um=5.0, reflectance=0.4
    )
    return nominal_render(replace(shown, static=(lid,)))


@pytest.mark.parametrize("hide", [without_notch, with_lid])
def test_a_hidden_notch_is_no_angle(hide: object) -> None:
    # any tooth would fit as well: an answer would be wrong 17 times of 18
    assert callable(hide)
    rng = np.random.default_rng(34)
    for z_um in (0.0, 0.0, 4.0, 8.0):
        drawn = draw("find_gear", rng, z_um=z_um)
        image = noisy(case("find_gear"), drawn.render(hide(drawn)), rng)
        found = measure("find_gear", image, around("find_gear", drawn, 0.3, 1.0))
        assert isinstance(found, Failure)
        assert found.code == "ambiguous"


def test_other_turns_are_those_within_the_range() -> None:
    period = math.tau / TEETH
    every = other_turns(0.1, TEETH, math.pi)
    assert len(every) == TEETH - 1
    steps = (every - 0.1) / period
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)
    assert (np.abs(every) <= math.pi).all()
    assert len(other_turns(0.1, TEETH, 0.2)) == 0
    np.testing.assert_allclose(other_turns(0.2, TEETH, 0.26), [0.2 - period])
    assert len(other_turns(0.1, 1, math.pi)) == 0


@pytest.mark.parametrize("name", ["find_gear", "post"])
@pytest.mark.parametrize("shade", [0.0, 0.3, 0.75])
def test_half_a_target_hidden_is_found_rightly_or_refused(
    name: str, shade: float
) -> None:
    rng = np.random.default_rng(35)
    rows, columns = np.mgrid[:200, :200].astype(np.float64)
    for k in range(4):
        drawn, angle = draw(name, rng, z_um=2.5 * k), rng.uniform(0, math.tau)
        pose, image = drawn.pose(case(name)), drawn.render(render(name))
        side = (columns - pose.column) * math.cos(angle)
        side += (rows - pose.row) * math.sin(angle)
        hidden = noisy(case(name), np.where(side > 0, shade, image), rng)
        found = measure(name, hidden, around(name, drawn, 0.5, angle + 1))
        if isinstance(found, Failure):
            assert found.code in ("misfit", "diverged", "outside", "ambiguous")
            continue
        assert off(name, drawn, found)[0] < 5 * found.spread_px


@cache
def nothings() -> tuple[FloatArray, ...]:
    sizes = ((200, 200), (8, 8), (1, 1))
    flat = [np.full(size, value) for size in sizes for value in (0.0, 0.4, 1.0)]
    return *flat, np.random.default_rng(36).random((200, 200))


def nothing() -> Iterator[FloatArray]:
    for image in nothings():
        image.setflags(write=False)
        yield image


@pytest.mark.parametrize("name", ["find_gear", "post", "over_shaft", "far_gear"])
def test_images_of_nothing_are_refused(name: str) -> None:
    target = case(name).target
    for image in nothing():
        before = image.tobytes()
        found = measure(name, image, Guess(column=target.column, row=target.row))
        assert isinstance(found, Failure)
        assert found.code
        assert found.message
        assert image.tobytes() == before


def test_a_measured_image_is_left_as_it_is() -> None:
    rng = np.random.default_rng(37)
    drawn = draw("find_gear", rng)
    image = photo("find_gear", drawn, rng)
    image.setflags(write=False)
    before, guess = image.tobytes(), around("find_gear", drawn, 0.4, 2.0)
    found = measure("find_gear", image, guess)
    assert isinstance(found, Measurement)
    assert measure("find_gear", image, guess) == found
    assert image.tobytes() == before


def test_a_guess_beyond_the_fits_reach_is_refused() -> None:
    drawn = Drawn()
    image = drawn.render(render("post"))
    for away_px in (5.0, 60.0, 1e4):
        found = measure("post", image, around("post", drawn, away_px, 0.3))
        assert isinstance(found, Failure)
