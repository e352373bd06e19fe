"""Contour matching on rendered parts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour import match as contour_match
from microplan.featuresel.routines.contour.model import ROUND, build
from microplan.featuresel.routines.contour.polarity import predict
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.optics.outline.outline import Outline, place

# Radial calipers came to 8.8 times the Cramer-Rao limit in focus in the measurements
# this project started from; edges along all of the contour must not do worse.
RATIO = 8.8
Look = Callable[[str], LookCase]


PREPARED: dict[str, Artifact] = {}  # of looks as they are: preparing takes seconds


def of(look: Look, name: str) -> tuple[LookCase, Artifact]:
    case = look(name)
    if name not in PREPARED:
        PREPARED[name] = prepared(case)
    return case, PREPARED[name]


def prepared(case: LookCase) -> Artifact:
    artifact = contour_match.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact), artifact
    return artifact


def start(case: LookCase) -> Guess:
    return Guess(column=case.target.column, row=case.target.row)


def error_um(case: LookCase, found: Measurement, dx: float, dy: float) -> float:
    x, y = case.frame.to_world(found.column, found.row)
    return math.hypot(x - case.x_um - dx, y - case.y_um - dy)


@pytest.mark.parametrize("name", ["find_gear", "between", "bracket", "post"])
def test_errors_are_near_the_limit(
    name: str, look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look(name), "contour_match", draws=12)
    assert sample.failures == ()
    rms = np.sqrt((sample.errors_um**2).mean(axis=0))
    assert (rms < RATIO * sample.limit_um).all(), rms / sample.limit_um
    # the rim, 50 to 160 um out, moves no more than twice what the whole does
    if name != "post":
        assert len(sample.turns_rad) == 12
        assert np.abs(sample.turns_rad).max() * 50 < 4 * RATIO * sample.limit_um


def test_jaws_are_found_within_the_pixel_locking_of_straight_edges(
    look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look("jaws"), "contour_match", draws=6)
    assert sample.failures == ()
    # edges along pixel rows sample one phase only: no more than .05 px
    assert np.abs(sample.errors_um).max() < 0.05 / 0.92
    assert np.abs(sample.turns_rad).max() * 160 < 0.05 / 0.92


def test_spreads_are_honest_at_any_angle(
    look: Look, measured: Callable[..., Any]
) -> None:
    case = look("bracket")
    # the samples are in focus: what focus errors add must not be in the spread
    steady = replace(case, spread=replace(case.spread, focus_sigma_um=0.0))
    sample = measured(steady, "contour_match", draws=24)
    rms = np.sqrt((sample.errors_um**2).mean())
    # chi^2 of 48 errors: a factor 1.3 at the 1 % level; 1.4 for its own error
    assert 1 / 1.8 < sample.spreads_um.mean() / rms < 1.8


@pytest.mark.parametrize("focus_um", [-10.0, 10.0])
def test_it_works_out_of_focus_at_any_angle(focus_um: float, look: Look) -> None:
    case = replace(look("find_gear"), focus_um=focus_um)
    artifact, render = prepared(case), nominal_render(case)
    for turn in np.arange(18) * math.tau / 18 + 0.05:
        image = render(dx_um=4.0, dy_um=-3.0, theta_rad=float(turn))
        found = contour_match.measure(image, artifact, start(case))
        assert isinstance(found, Measurement), found
        assert found.theta_rad is not None
        off = math.remainder(found.theta_rad - case.theta_rad - turn, math.tau)
        assert abs(off) * 50 < 0.1
        assert error_um(case, found, 4.0, -3.0) < 0.1


def test_a_gear_without_its_notch_is_not_given_an_angle(look: Look) -> None:
    case, artifact = of(look, "find_gear")
    layer = case.moving[0]
    outer = Outline(rings=layer.outline.rings[:1])
    whole = nominal_render(replace(case, moving=(replace(layer, outline=outer),)))
    found = contour_match.measure(whole(), artifact, start(case))
    assert isinstance(found, Failure)
    assert found.code in {"no_notch", "ambiguous", "few_edges"}


def test_what_cannot_tell_an_angle_says_none(look: Look) -> None:
    case = look("find_gear")
    layer = case.moving[0]
    outer = Outline(rings=layer.outline.rings[:1])
    plain = replace(
        case,
        moving=(replace(layer, outline=outer),),
        target=replace(
            case.target,
            contour=tuple(p for p in case.target.contour if math.hypot(*p[:2]) > 40),
        ),
    )
    image = nominal_render(plain)(dx_um=2.0, theta_rad=1.0)
    found = contour_match.measure(image, prepared(plain), start(plain))
    assert isinstance(found, Measurement)
    assert found.theta_rad is None
    assert error_um(plain, found, 2.0, 0.0) < 0.05


@pytest.mark.parametrize(
    ("name", "order"), [("find_gear", 18), ("post", ROUND), ("bracket", 1)]
)
def test_symmetries_are_those_of_the_drawing(name: str, order: int, look: Look) -> None:
    case = look(name)
    model = build(case.target, predict(nominal_render(case), case.target))
    assert model.order == order
    broken = model.points[model.breaking, :2] / case.target.px_per_um
    assert (len(broken) > 0) == (name == "find_gear")
    # by the notch, which is at 90 degrees
    assert (broken[:, 1] > 22).all()
    assert (np.abs(broken[:, 0]) < 3.5).all()


def test_light_zoom_and_focus_errors_do_not_lead_it_astray(
    look: Look, expose_image: Callable[..., Any]
) -> None:
    case, artifact = of(look, "between")
    rng = np.random.default_rng(5)
    for gain, gradient, zoom, focus in (
        (0.7, 0.3, 1.01, 4.0),
        (1.3, -0.3, 0.99, -4.0),
        (0.7, -0.3, 1.01, -8.0),
    ):
        scope = case.microscope
        seen = replace(
            case,
            microscope=replace(scope, magnification=scope.magnification * zoom),
            focus_um=focus,
            light=replace(case.light, gain=gain, gradient_x=gradient),
        )
        image = expose_image(case, nominal_render(seen)(dx_um=5, theta_rad=0.2), rng)
        found = contour_match.measure(image, artifact, start(case))
        assert isinstance(found, Measurement), found
        assert found.theta_rad == pytest.approx(case.theta_rad + 0.2, abs=0.01)
        assert error_um(case, found, 5.0, 0.0) < 0.3


@pytest.mark.parametrize("level", [0.0, 0.1, 0.7, 1.0])
def test_an_empty_image_is_refused(
    level: float, look: Look, expose_image: Callable[..., Any]
) -> None:
    rng = np.random.default_rng(1)
    for name in ("find_gear", "post", "jaws"):
        case, artifact = of(look, name)
        shape = (case.window.rows, case.window.columns)
        blank = expose_image(case, np.full(shape, level), rng)
        found = contour_match.measure(blank, artifact, start(case))
        assert isinstance(found, Failure)


def test_noise_tiny_images_and_other_parts_are_refused(look: Look) -> None:
    rng = np.random.default_rng(2)
    (gear, artifact), bracket = of(look, "find_gear"), look("bracket")
    for image in (
        rng.random((200, 200)),
        np.zeros((1, 1)),
        rng.random((3, 7)),
        nominal_render(bracket)()[:200, :200],
        0.9 - nominal_render(gear)(),  # the polarity is the other one
    ):
        before = image.copy()
        found = contour_match.measure(image, artifact, start(gear))
        assert isinstance(found, Failure)
        np.testing.assert_array_equal(image, before)


def test_two_parts_in_the_search_are_ambiguous(look: Look) -> None:
    case = look("post")
    case = replace(case, target=replace(case.target, search_px=40.0))
    layer = case.moving[0]
    second = replace(layer, outline=place(layer.outline, 50.0, 0.0, 0.0))
    both = replace(case, moving=(layer, second))
    found = contour_match.measure(
        nominal_render(both)(dx_um=-20), prepared(case), start(case)
    )
    assert isinstance(found, Failure)
    assert found.code == "ambiguous"


def test_a_part_without_contrast_or_drawing_cannot_be_prepared(look: Look) -> None:
    case = look("bracket")
    dull = replace(case, moving=(replace(case.moving[0], reflectance=0.1),))
    blank = replace(case, target=replace(case.target, contour=()))
    for one in (dull, blank):
        found = contour_match.prepare(nominal_render(one), one.target)
        assert isinstance(found, Failure)
        assert found.code == "no_edge"
