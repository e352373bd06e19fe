"""Edges and blobs far out of focus are no gradient, and what lamps make is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.even_field.field_light import field_light
from microplan.planner.calibration.even_field.field_structure import (
    SURE,
    FieldStructure,
    field_structure,
)

SIZE = (96, 128)
NOISE = 0.002  # of a pixel, as a mean of frames has it
ROW, COLUMN = np.indices(SIZE)
X, Y = (COLUMN - 63.5) / 48, (47.5 - ROW) / 48
CORNER = math.hypot(4 / 3, 1)
ERF = np.vectorize(math.erf)


def lamp(rng: np.random.Generator) -> FloatArray:
    """Return a tilt of 10 to 30 % from border to border, to 20 % less in the corners.

    As they multiply or add up, by parabola or the fourth power of a cosine, about a
    middle up to some pixels off the picture's.
    """
    angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.3) / 2
    tilt = size * (X * np.cos(angle) + Y * np.sin(angle))
    off_x, off_y = rng.normal(0, 0.1, 2)
    square = ((X - off_x) ** 2 + (Y - off_y) ** 2) / CORNER**2
    dim = rng.uniform(0, 0.2)
    fall = [1 - dim * square, (1 + ((1 - dim) ** -0.5 - 1) * square) ** -2.0]
    bowl = -rng.uniform(0, 0.1) * square
    light = [(1 + tilt) * (1 + bowl), 1 + tilt + bowl][rng.integers(2)]
    return np.asarray(0.5 * light * fall[rng.integers(2)])


def step(rng: np.random.Generator, height: float, px: float) -> FloatArray:
    """Return the light, over that without, of an edge so wide from 10 to 90 %."""
    angle, at = rng.uniform(0, np.pi), rng.uniform(-0.9, 0.9)
    along = X * np.cos(angle) + Y * np.sin(angle) - at
    sigma = px / 48 / 2.5631
    return np.asarray(1 + height / 2 * ERF(along / sigma / math.sqrt(2)))


def noisy(light: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.asarray(light * (1 + NOISE * rng.standard_normal(SIZE)))


def plane(light: FloatArray) -> FloatArray:
    """Return the change over width and height of a plane through light, (2,)."""
    columns = [np.ones(light.size), (X / (8 / 3)).ravel(), (Y / 2).ravel()]
    found = np.linalg.lstsq(np.stack(columns, axis=1), light.ravel(), rcond=None)[0]
    return np.asarray(found[1:] / found[0])


def structure(cells: FloatArray, sigma: float) -> FieldStructure:
    clean = np.ones(cells.shape, dtype=np.bool_)
    return field_structure(cells, (X, Y), clean, sigma)


@pytest.mark.slow
def test_tilted_vignetted_fields_are_refused_in_two_of_a_hundred() -> None:
    rng = np.random.default_rng(0)
    found = [field_light(noisy(lamp(rng), rng)) for _ in range(150)]
    assert sum(isinstance(each, Refused) for each in found) <= 3


@pytest.mark.slow
def test_steps_are_refused_or_within_two_stated_deviations() -> None:
    """Of 1 to 30 % of the light, a twentieth of the shorter side to all of it wide."""
    rng, passed, refused = np.random.default_rng(1), 0, 0
    for _ in range(200):
        light = lamp(rng)
        height, px = 0.01 * 30 ** rng.random(), 4.8 * 20 ** rng.random()
        edge = light * step(rng, height, px)
        found = field_light(noisy(edge, rng))
        if isinstance(found, Refused):
            refused += 1
            continue
        assert found.gradient.covariance is not None
        sigma = np.sqrt(np.diag(found.gradient.covariance))
        passed += bool(np.any(np.abs(plane(edge) - plane(light)) > 2 * sigma))
    assert passed <= 0.05 * 200
    assert refused > 100


@pytest.mark.parametrize("px", [12.0, 24.0, 48.0])
@pytest.mark.parametrize("angle", [0.0, 0.5, 1.5])
def test_large_edges_out_of_focus_say_what_they_may_do(px: float, angle: float) -> None:
    along = X * np.cos(angle) + Y * np.sin(angle) - 0.2
    light = 0.5 + 0.05 * ERF(along * 48 * 2.5631 / px / math.sqrt(2))
    found = field_light(noisy(light, np.random.default_rng(2)))
    assert isinstance(found, Refused)
    assert "it shows something" in found.why
    assert "wider than the field" in found.take


def test_blobs_beside_the_middle_are_refused() -> None:
    light = 0.5 * (1 + 0.1 * np.exp(-((X - 0.6) ** 2 + (Y + 0.3) ** 2) / 0.18))
    found = field_light(noisy(light, np.random.default_rng(3)))
    assert isinstance(found, Refused)
    assert "it shows something" in found.why


def test_noise_alone_is_never_sure() -> None:
    rng = np.random.default_rng(4)
    sure = [
        structure(1 + 0.01 * rng.standard_normal(SIZE), 0.01).sure for _ in range(6)
    ]
    assert max(sure) < SURE
    assert min(sure) > 1


def test_a_step_comes_out_with_height_width_and_shift() -> None:
    along = X * np.cos(0.4) + Y * np.sin(0.4) - 0.3
    light = 1 + 0.05 * ERF(along * 48 * 2.5631 / 24 / math.sqrt(2))
    found = structure(light / light.mean(), 1e-4)
    assert abs(found.height) == pytest.approx(0.1, rel=0.1)
    assert found.width == pytest.approx(24 / 96, rel=0.4)  # what is tried lies apart
    moved = np.hypot(*plane(light))
    assert moved < 1.1 * found.shift
    assert found.shift < 3 * moved  # wider ones suit nearly as well


def test_what_noise_may_hide_is_as_large_as_noise() -> None:
    rng = np.random.default_rng(5).standard_normal(SIZE)
    one, other = (structure(1 + s * rng, s).hidden for s in (1e-3, 1e-4))
    np.testing.assert_allclose(one, 10 * other, rtol=0.2)
    assert np.all(one > 2e-3)
