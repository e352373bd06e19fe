"""Gradients come out of fields with nothing in them, of others there is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely.geometry import box

from microplan.arrays import FloatArray
from microplan.planner.calibration.calibrated_value import PictureSource
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.even_field.field_light import (
    FieldLight,
    field_light,
)
from microplan.planner.calibration.geometry.light_field import gradient_values
from tests.planner.calibration.twin_series import LENS, SIZE, UM_PER_PX
from validation.twins.camera import Camera, dusted, exposed, graded
from validation.twins.optics import image
from validation.twins.scenes import Body, Scene

CAMERA = Camera(full_well=20_000.0, read_noise=1.0, pattern=0.5)
ACROSS, UP = 0.12, -0.05


def shown(light: FloatArray, seed: int = 0, camera: Camera = CAMERA) -> FloatArray:
    """Return the light that a camera's picture tells."""
    counts = exposed(light, camera, np.random.default_rng(seed))
    return np.asarray(counts, dtype=np.float64) / camera.top


def field(across: float = ACROSS, up: float = UP) -> FloatArray:
    return graded(np.full(SIZE, 0.5), across, up)


def told(light: FloatArray) -> FieldLight:
    found = field_light(light)
    assert isinstance(found, FieldLight), found
    return found


def chance(found: FieldLight) -> FloatArray:
    """Return the deviations (2,) of a gradient but for structures that noise hides."""
    assert found.gradient.covariance is not None
    return np.sqrt(np.diag(found.gradient.covariance) - found.hidden**2)


@pytest.mark.slow
@pytest.mark.parametrize("specks", [0, 12])
def test_gradients_come_out_within_their_deviations(specks: int) -> None:
    """Of 120 pulls by 33 numbers the mean square is 33/31 +- .14."""
    pulls = []
    for seed in range(60):
        light = dusted(field(), specks, np.random.default_rng([seed, 1]), 1.0)
        found = told(shown(light, seed))
        off = found.gradient.values - (ACROSS, UP)
        pulls += (off / chance(found)).tolist()
    assert 0.6 < np.mean(np.square(pulls)) < 1.5


def test_what_no_plane_explains_is_left_over() -> None:
    """Against the plane through the pixels' light itself, without a camera."""
    right, up = (field(*a) / 0.5 - 1 for a in ((1.0, 0.0), (0.0, 1.0)))
    light = field() * (1 - 0.3 * (right**2 + up**2))
    design = np.stack([np.ones(light.size), right.ravel(), up.ravel()], axis=1)
    plane, left, *_ = np.linalg.lstsq(design, light.ravel(), rcond=None)
    rms = float(np.sqrt(left[0] / light.size) / plane[0])
    found = told(shown(light))
    assert found.departure.sigma
    assert abs(found.departure.value - rms) < 4 * found.departure.sigma
    assert found.departure.value == pytest.approx(rms, rel=0.05)
    off = found.gradient.values - plane[1:] / plane[0]
    assert np.all(np.abs(off) < 4 * chance(found))


@pytest.mark.parametrize("share", [0.15, 0.25])
def test_vignetting_moves_no_gradient(share: float) -> None:
    """It is in what is left: of 40 pulls the mean square is 1 +- .22."""
    right, up = (field(*a) - 0.5 for a in ((4.0, 0.0), (0.0, 4.0)))  # -1 to 1
    dim = 1 - share * (right**2 + up**2)
    mean = float(dim.mean())
    light = field() * dim / mean
    design = np.stack([np.ones(light.size), right.ravel(), up.ravel()], axis=1)
    plane, left, *_ = np.linalg.lstsq(design, light.ravel(), rcond=None)
    true = 2 * plane[1:] / plane[0]
    pulls, source = [], PictureSource(pictures=1, sha256="0")
    for seed in range(20):
        found = told(shown(light, seed))
        assert chance(found).max() < 0.001
        pulls += ((found.gradient.values - true) / chance(found)).tolist()
        size = next(gradient_values(found.gradient, source, None, found.hidden))
        assert size.value == pytest.approx(np.hypot(*true), abs=0.005)
        rms = float(np.sqrt(left[0] / light.size) / plane[0])
        assert found.departure.value == pytest.approx(rms, rel=0.05)
    assert 0.5 < np.mean(np.square(pulls)) < 1.6


def test_a_plane_leaves_nothing_over() -> None:
    """Noise of the cells is taken off; half of its squares are below 0."""
    found = [told(shown(field(), seed)).departure for seed in range(20)]
    assert all(each.value < 4 * (each.sigma or 0.0) for each in found)
    assert 3 < sum(each.value == 0 for each in found) < 17


def test_values_are_a_workcells_line_and_both_axes() -> None:
    source = PictureSource(pictures=1, sha256="0")
    found = told(shown(field()))
    size, x, y = gradient_values(found.gradient, source, 0.1, found.hidden)
    assert size.where == ("light", "gradient")
    assert size.value == pytest.approx(0.13, abs=0.005)
    assert (x.value, y.value) == pytest.approx((ACROSS, UP), abs=0.005)


def test_dust_moves_nothing() -> None:
    light = dusted(field(), 12, np.random.default_rng(1), 1.0)
    found = told(shown(light))
    assert 0 < found.dust < 0.2
    assert found.gradient.values == pytest.approx((ACROSS, UP), abs=0.003)


def _square(reflectance: float) -> FloatArray:
    part = Body(shape=box(-6, -5, 7, 6), reflectance=reflectance)
    return image(Scene(bodies=(part,), background=0.5), LENS, SIZE, UM_PER_PX)


def _board(cell: int) -> FloatArray:
    row, column = np.indices(SIZE) // cell
    return np.asarray(0.4 + 0.2 * ((row + column) % 2), dtype=np.float64)


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (lambda: _square(0.8), "it shows something"),
        (lambda: _square(0.53), "it shows something"),
        (lambda: field() + 0.1 * (np.arange(SIZE[1]) > 90), "it shows something"),
        (lambda: _board(16), "it shows something"),
        (lambda: _board(3), "between neighbouring areas"),
        (lambda: field() * 0.05, "of full scale, less than 5%"),
        (lambda: np.zeros(SIZE), "its light is 0.20% of full scale"),
        (lambda: field()[:16], "pictures of 128 x 16 px are too small"),
    ],
)
def test_fields_that_are_not_even_are_refused(
    made: Callable[[], FloatArray], why: str
) -> None:
    found = field_light(shown(made()))
    assert isinstance(found, Refused)
    assert why in found.why
    assert "empty stage" in found.take


def test_a_field_without_noise_is_told_exactly() -> None:
    found = told(field())
    assert found.gradient.values == pytest.approx((ACROSS, UP), abs=1e-9)
    assert found.departure.value < 1e-6
