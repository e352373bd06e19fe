"""What is known of a lens: numbers that can be, apertures, light."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from microplan.optics.lens.lens import LensErrors
from tests.optics.shapes import microscope

OPTICS = microscope()
OFF = LensErrors()


def _with(name: str, value: float) -> LensErrors:
    """Return a lens with one number set."""
    numbers: dict[str, Any] = {name: value}
    return replace(OFF, **numbers)


@pytest.mark.parametrize("name", [n for n in LensErrors.__slots__ if n != "apertures"])
def test_errors_that_are_no_numbers_are_refused(name: str) -> None:
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=f"{name} must be finite"):
            _with(name, value)
    if "sigma" in name:
        with pytest.raises(ValueError, match=f"{name} must not be negative"):
            _with(name, -1e-9)


def test_errors_out_of_range_are_refused() -> None:
    for sign in (-1, 1):
        with pytest.raises(ValueError, match=r"distortion must be at most 0\.25"):
            LensErrors(distortion=0.2501 * sign)
    with pytest.raises(ValueError, match="must not make the light vanish"):
        LensErrors(gradient_x=1.0, gradient_y=-1.0)


def test_an_aperture_between_two_is_a_power_of_the_magnification() -> None:
    lens = LensErrors(apertures=((2.0, 0.1), (8.0, 0.4), (32.0, 0.42)))
    assert lens.aperture_at(2.0) == pytest.approx(0.1, rel=1e-15)
    assert lens.aperture_at(4.0) == pytest.approx(0.2, rel=1e-14)  # proportional
    assert lens.aperture_at(16.0) == pytest.approx(math.sqrt(0.4 * 0.42), rel=1e-14)
    assert lens.aperture_at(32.0) == pytest.approx(0.42, rel=1e-15)


@pytest.mark.parametrize("magnification", [1.999, 32.001, math.nan])
def test_an_aperture_outside_the_table_is_refused(magnification: float) -> None:
    lens = LensErrors(apertures=((2.0, 0.1), (32.0, 0.42)))
    with pytest.raises(ValueError, match=r"known: 2\.0\.\.32\.0"):
        lens.aperture_at(magnification)
    with pytest.raises(ValueError, match="known: none"):
        OFF.aperture_at(6.9)


@pytest.mark.parametrize(
    "table",
    [
        ((2.0, 0.1),),
        ((2.0, 0.1), (2.0, 0.2)),
        ((3.0, 0.1), (2.0, 0.2)),
        ((2.0, 0.1), (3.0, 0.0)),
        ((2.0, 0.1), (math.nan, 0.2)),
    ],
)
def test_a_table_that_is_no_function_is_refused(
    table: tuple[tuple[float, float], ...],
) -> None:
    with pytest.raises(ValueError, match="apertures"):
        LensErrors(apertures=table)
