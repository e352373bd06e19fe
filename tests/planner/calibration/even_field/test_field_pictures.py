"""Pictures of one field agree by chance, and of fields that differ do not."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.planner.calibration.even_field.field_pictures import (
    FieldPictures,
    plane_change,
    rounding_sigma,
)
from tests.planner.calibration.even_field.test_field_light import field, shown


def test_one_light_and_a_flicker_of_it_agree() -> None:
    pictures = FieldPictures()
    bent = 1 - np.linspace(-0.4, 0.4, field().shape[1]) ** 2
    lights = [shown(field() * bent * (1 - 0.01 * k), k) for k in range(40)]
    assert not any(pictures.add(light, 0.0) for light in lights)
    assert pictures.mean is not None
    np.testing.assert_allclose(pictures.mean, np.mean(lights, axis=0))


@pytest.mark.parametrize(
    ("across", "up", "way"), [(0.1, -0.05, "width"), (0.12, -0.07, "height")]
)
def test_another_gradient_contradicts(across: float, up: float, way: str) -> None:
    pictures = FieldPictures()
    assert not pictures.add(shown(field()), 0.0)
    off = pictures.add(shown(field(across, up), 1), 0.0)
    assert off.startswith("its gradient differs by -0.0")
    assert off.endswith(f"over the {way}")
    assert not pictures.add(shown(field(0.125, -0.045), 1), 0.0)


def test_pictures_without_light_contradict_nothing() -> None:
    pictures = FieldPictures()
    dark = shown(field() * 0) - 0.01
    assert not any(pictures.add(dark - 0.001 * k, 0.0) for k in range(3))


def test_planes_come_out_within_their_deviations() -> None:
    """Of 200 pulls by 36 numbers, 6 of them fitted, the mean square is near 1."""
    rng, pulls = np.random.default_rng(0), []
    y, x = np.mgrid[0.5:-0.5:13j, -0.5:0.5:13j][:, 1::2, 1::2]
    for _ in range(100):
        seen = (
            0.1 * x - 0.2 * y - 0.5 * (x * x + y * y) + 1e-3 * rng.normal(size=(6, 6))
        )
        for k, true in enumerate((0.1, -0.2)):
            one = plane_change(seen).one(k)
            assert one.sigma
            pulls.append((one.value - true) / one.sigma)
    assert 0.6 < np.mean(np.square(pulls)) < 1.4


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.5, 1.0])
def test_rounding_errs_by_no_more_than_is_said(noise: float) -> None:
    """Means over a field of lights all over a step between counts."""
    rng = np.random.default_rng(0)
    lights = 100 + np.arange(40)[:, None, None] / 40
    counts = np.rint(lights + noise * rng.standard_normal((40, 64, 64)))
    off = np.sqrt(np.mean((counts.mean(axis=(1, 2)) - lights.ravel()) ** 2))
    said = np.sqrt(np.mean([rounding_sigma(each) ** 2 for each in counts]))
    chance = np.sqrt(noise**2 + 1 / 12) / 64
    assert off < said + chance
    assert said < (0.29 if noise < 0.5 else 0.02)
