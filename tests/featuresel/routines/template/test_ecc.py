"""ECC alignment on rendered parts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.template import ecc

Look = Callable[[str], LookCase]


def prepared(case: LookCase) -> Artifact:
    artifact = ecc.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    return artifact


def near(
    case: LookCase, dx: float, dy: float, turn: float, off_px: float = 0.5
) -> Guess:
    """Return a guess `off_px` to the right and .02 rad off."""
    k = case.target.px_per_um
    return Guess(
        column=case.target.column + dx * k + off_px,
        row=case.target.row - dy * k,
        theta_rad=case.theta_rad + turn + 0.02,
    )


@pytest.mark.parametrize("turn", [0.0, 0.7, 1.6, 2.9, -1.0, -2.2])
def test_any_angle_is_held(turn: float, look: Look, expose_image: Any) -> None:
    case = replace(look("bracket"), focus_um=10.0)
    artifact, rng = prepared(case), np.random.default_rng(5)
    image = nominal_render(case)(dx_um=3.1, dy_um=-2.2, theta_rad=turn)
    found = ecc.measure(
        expose_image(case, image, rng), artifact, near(case, 3.1, -2.2, turn)
    )
    assert isinstance(found, Measurement)
    assert found.theta_rad is not None
    assert found.spread_theta_rad is not None
    x, y = case.frame.to_world(found.column, found.row)
    spread_um = found.spread_px / case.target.px_per_um
    # 4 sigma of a two-dimensional error: 3 in ten thousand
    assert math.hypot(x - case.x_um - 3.1, y - case.y_um + 2.2) < 4 * spread_um
    off = math.remainder(found.theta_rad - case.theta_rad - turn, math.tau)
    assert abs(off) < 4 * max(found.spread_theta_rad, spread_um / 85)


def test_out_of_focus_it_is_at_the_limit(
    look: Look, measured: Callable[..., Any]
) -> None:
    # ECC came to 1.5 times the Cramer-Rao limit at z = 10 um in the measurements this
    # project started from
    sample = measured(replace(look("post"), focus_um=10.0), "ecc", within_um=2)
    assert sample.failures == ()
    rms = np.sqrt((sample.errors_um**2).mean(axis=0))
    assert (rms < 1.5 * sample.limit_um).all(), rms / sample.limit_um


def test_the_last_step_undoes_the_warps_rounding(look: Look) -> None:
    # Places between the 1/32 px that OpenCV's warp knows, near focus but blurred enough
    # for bilinear values: rounding alone would leave up to 1/64 px at some of them.
    case = replace(look("post"), focus_um=10.0)
    artifact, k = prepared(case), case.target.px_per_um
    errors = []
    for step in range(8):
        dx = step / 8 / 32 / k
        image = nominal_render(case)(dx_um=dx)
        found = ecc.measure(image, artifact, near(case, dx, 0.0, 0.0))
        assert isinstance(found, Measurement)
        errors.append(found.column - case.target.column - dx * k)
    assert np.ptp(errors) < 1 / 64 / 4


def test_capture_is_as_stated(look: Look) -> None:
    for name in ("find_gear", "post", "jaws"):
        case = look(name)
        artifact = prepared(case)
        image = nominal_render(case)(dx_um=1.0, theta_rad=0.0)
        for off in (ecc.ECC.capture_px, -ecc.ECC.capture_px):
            found = ecc.measure(image, artifact, near(case, 1.0, 0.0, 0.0, off))
            assert isinstance(found, Measurement)
            x, y = case.frame.to_world(found.column, found.row)
            assert math.hypot(x - case.x_um - 1.0, y - case.y_um) < 0.05


@pytest.mark.parametrize("zoom", [0.985, 1.015])  # three sigmas of the look
def test_a_zoom_error_does_not_take_the_fingers_grip_along(
    zoom: float, look: Look
) -> None:
    case = look("jaws")
    scope = replace(case.microscope, magnification=zoom * case.microscope.magnification)
    image = nominal_render(replace(case, microscope=scope))(dx_um=1.0)
    found = ecc.measure(image, prepared(case), near(case, 1.0, 0.0, 0.0))
    assert isinstance(found, Measurement)
    x, y = case.frame.to_world(found.column, found.row)
    off = math.hypot(x - zoom * (case.x_um + 1.0), y - zoom * case.y_um)
    # without a scale the grip goes with the tips, by .9 um; what is left is
    # the sampling of edges in focus, a few hundredths of a pixel
    assert off < 0.05


def test_a_scale_is_fitted_to_ten_microns_out_of_focus_and_not_beyond(
    look: Look,
) -> None:
    case = look("jaws")
    artifact = prepared(case)
    found = [
        ecc.measure(
            nominal_render(replace(case, focus_um=z, model="exact"))(),
            artifact,
            near(case, 0.0, 0.0, 0.0),
        )
        for z in (10.0, 25.0)
    ]
    assert isinstance(found[0], Measurement)
    assert found[0].score == pytest.approx(0.975, abs=0.01)
    assert isinstance(found[1], Failure)


def test_a_scale_is_sought_only_where_it_moves_the_place(look: Look) -> None:
    scales = {n: prepared(look(n)).parameters["scales"] for n in ("post", "jaws")}
    assert scales == {"post": 0.0, "jaws": 1.0}
    case = look("jaws")
    sure = replace(case, spread=replace(case.spread, magnification_sigma=0.0))
    assert prepared(sure).parameters["scales"] == 0.0


def test_a_disc_has_no_angle_and_needs_none(look: Look) -> None:
    case = look("post")
    artifact = prepared(case)
    bare = Guess(column=case.target.column, row=case.target.row)
    found = ecc.measure(nominal_render(case)(), artifact, bare)
    assert isinstance(found, Measurement)
    assert found.theta_rad is None
    gear = look("find_gear")
    refused = ecc.measure(nominal_render(gear)(), prepared(gear), bare)
    assert isinstance(refused, Failure)
    assert refused.code == "no_angle"


def test_what_is_not_the_target_is_refused(look: Look, expose_image: Any) -> None:
    case = look("find_gear")
    artifact, at = prepared(case), near(look("find_gear"), 0, 0, 0)
    noise = expose_image(case, np.full((200, 200), 0.4), np.random.default_rng(2))
    for image in (noise, nominal_render(look("post"))()):
        found = ecc.measure(image, artifact, at)
        assert isinstance(found, Failure)
        assert found.code in {"diverged", "low_score"}
    far = replace(at, column=at.column + 60)
    found = ecc.measure(nominal_render(case)(), artifact, far)
    assert isinstance(found, Failure)
    assert found.code in {"diverged", "low_score", "outside"}


def test_a_blank_look_cannot_be_prepared(look: Look) -> None:
    case = look("post")
    dull = replace(case, moving=(replace(case.moving[0], reflectance=0.15),))
    found = ecc.prepare(nominal_render(dull), dull.target)
    assert isinstance(found, Failure)
    assert found.code == "no_contrast"
