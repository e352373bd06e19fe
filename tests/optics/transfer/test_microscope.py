"""The paper's numbers, and what replaces them."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.optics.vectors import paper_blur_um, paper_depth_of_field_um
from microplan.optics.transfer.microscope import Microscope

VECTORS = json.loads((Path(__file__).parents[1] / "optics_vectors.json").read_text())


def _setting(index: float = 1.0, magnification: float = 6.9) -> Microscope:
    return Microscope(
        aperture=0.42,
        wavelength_um=0.6,
        medium_index=index,
        magnification=magnification,
        pitch_um=12.45,  # the paper's "pixel"
        width_px=640,
        height_px=480,
    )


def _reference(name: str, index: str) -> float:
    found = [
        e for e in VECTORS["entries"] if e["name"] == name and e["params"]["n"] == index
    ]
    assert len(found) == 1
    return float(found[0]["value"])


def test_the_resolution_is_the_airy_radius_in_object_space() -> None:
    # the paper quotes eq. (4), 1.22 wavelength m / A, a diameter on the sensor
    setting = _setting()
    assert setting.airy_radius_um == pytest.approx(0.871, abs=5e-4)
    diameter = 2 * setting.airy_radius_um * setting.magnification
    assert diameter == pytest.approx(12.0257, abs=5e-5)


def test_the_papers_pixel_is_1804_nm_in_object_space() -> None:
    assert _setting().um_per_px == pytest.approx(1.804, abs=5e-4)


def test_equation_5_gives_the_papers_number() -> None:
    value = paper_depth_of_field_um(_setting(index=1.5))
    assert value == pytest.approx(_reference("paper_eq5_total_dof_um", "1.5"), 1e-14)


def test_equation_5_turns_negative_and_is_replaced_by_the_wave_depth() -> None:
    # widths of blurs do not subtract: at high zoom a depth would be below zero
    assert paper_depth_of_field_um(_setting(index=1.5, magnification=44.5)) < 0
    depth = _setting(magnification=44.5).wave_depth_um
    assert depth == pytest.approx(_reference("dof_wave_quadratic_um", "1"), 1e-14)


def test_wave_depth_with_the_exact_phase() -> None:
    value = _setting(index=1.5).wave_depth_exact_um
    assert value == pytest.approx(_reference("dof_wave_exact_um", "1.5"), 1e-14)
    assert _setting().wave_depth_exact_um == pytest.approx(3.244, abs=5e-4)


def test_wave_depth_is_a_quarter_wave_at_either_end() -> None:
    setting = _setting()
    rim = setting.rim_w20_um(setting.wave_depth_exact_um / 2)
    near = setting.paraxial_w20_um(setting.wave_depth_um / 2)
    assert rim == pytest.approx(0.6 / 4, rel=1e-12)
    assert near == pytest.approx(0.6 / 4, rel=1e-12)


def test_equations_2_and_3_read_low_and_are_replaced_by_the_marginal_ray() -> None:
    setting = _setting()
    sine = _reference("geometric_blur_object_um", "1")
    tangent = _reference("geometric_blur_object_tan_um", "1")
    assert paper_blur_um(setting, 25) == pytest.approx(sine, rel=1e-14)
    assert setting.blur_diameter_um(25) == pytest.approx(tangent, rel=1e-14)
    # a ray at asin(A) meets a plane 25 um away at 25 tan(asin A)
    ray = 2 * 25 * math.tan(math.asin(0.42))
    assert setting.blur_diameter_um(-25) == pytest.approx(ray, rel=1e-12)
    assert sine / tangent == pytest.approx(1 - 0.0925, abs=1e-3)


@given(st.floats(0.01, 0.99), st.floats(1.0, 1.8), st.floats(-1e3, 1e3))
def test_the_rim_coefficient_is_the_exact_phase_of_the_marginal_ray(
    aperture: float, index: float, z_um: float
) -> None:
    setting = Microscope(
        aperture=aperture,
        wavelength_um=0.6,
        medium_index=index,
        magnification=10,
        pitch_um=7.5,
        width_px=1,
        height_px=1,
    )
    exact = z_um * (index - math.sqrt(index**2 - aperture**2))
    # the difference of roots loses digits at small A
    assert setting.rim_w20_um(z_um) == pytest.approx(exact, rel=1e-9, abs=1e-12)
    assert abs(setting.rim_w20_um(z_um)) >= abs(setting.paraxial_w20_um(z_um))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_numbers_that_cannot_be_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="magnification must be positive"):
        _setting(magnification=value)
