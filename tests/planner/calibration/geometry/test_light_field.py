"""Gradients of light come out of a part's brightness at places, or are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.calibration.calibrated_value import PictureSource
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    VectorEstimate,
)
from microplan.planner.calibration.geometry.face_ratio import face_ratios
from microplan.planner.calibration.geometry.light_field import (
    PlacedGain,
    gradient_values,
    light_gradient,
    part_gain,
)
from tests.featuresel.conftest import disc, make_case

GRID = [(x, y) for x in (-0.3, 0.0, 0.3) for y in (-0.3, -0.1, 0.1, 0.3)]
SOURCE = PictureSource(pictures=12, sha256="0")


def places(
    x: float, y: float, *, flicker: float = 1e-3, seed: int = 0, share: float = 1.0
) -> list[list[PlacedGain]]:
    """Return a part of brightness .7 in light that changes by x and y."""
    rng = np.random.default_rng(seed)
    return [
        [
            PlacedGain(
                right=share * a,
                up=share * b,
                gain=0.7 * (1 + share * (x * a + y * b)) * (1 + flicker * rng.normal()),
            )
        ]
        for a, b in GRID
    ]


def told(some: list[list[PlacedGain]]) -> VectorEstimate:
    found = light_gradient(some)
    assert isinstance(found, VectorEstimate)
    return found


def test_parts_of_a_gradient_come_out_within_their_deviations() -> None:
    """The mean square of pulls of some nine free numbers is 9/7."""
    pulls = []
    for seed in range(100):
        found = told(places(0.1, -0.05, seed=seed))
        for k, true in enumerate((0.1, -0.05)):
            one = found.one(k)
            assert one.sigma
            pulls.append((one.value - true) / one.sigma)
    assert 0.9 < np.mean(np.square(pulls)) < 1.8


def test_the_size_is_what_a_workcell_has() -> None:
    found = told(places(0.3, 0.4, flicker=1e-4))
    size, x, y = gradient_values(found, SOURCE, 0.2)
    assert size.value == pytest.approx(0.5, abs=1e-3)
    assert (size.where, x.where, y.where) == (("light", "gradient"), None, None)
    assert size.sigma[0] == pytest.approx(1e-4 / 0.25 / 12**0.5, rel=0.9)
    assert size.pull


def test_even_light_has_no_size_by_chance() -> None:
    sizes = [
        next(gradient_values(told(places(0, 0, seed=k)), SOURCE, None)).value
        for k in range(60)
    ]
    assert np.mean(np.array(sizes) == 0) > 0.3  # half of the squares are below 0


def test_light_that_may_be_the_parts_own_brightness_is_refused() -> None:
    for some, why in (
        (places(0.1, 0)[:5], "5 places do not tell it from the part's own brightness"),
        (places(0.1, 0)[:4] * 2, "all places lie on a line"),
        (places(0.1, 0, flicker=0.02, share=0.05), "places so near one another"),
        ([[] for _ in GRID], "0 places"),
    ):
        found = light_gradient(some)
        assert isinstance(found, Refused)
        assert why in found.why
        assert "over all of the field, in the same light" in found.take


def test_gain_is_that_at_the_parts_place() -> None:
    row, column = np.indices((40, 60), dtype=np.float64)
    disc = np.hypot(row - 18, column - 25) < 9
    meant = np.asarray(0.1 + 0.7 * disc, dtype=np.float64)
    used = np.ones(meant.shape, dtype=np.bool_)
    light = 0.6 * (1 + 0.01 * (column - 25) - 0.005 * (row - 18))
    found = part_gain(light * meant + 0.03, meant[None], (25.0, 18.0), used)
    assert found == pytest.approx((0.03, 0.6))
    assert part_gain(-meant, meant[None], (25.0, 18.0), used) is None


def test_faces_on_a_part_are_told_in_light_that_changes_over_it() -> None:
    row, column = np.indices((40, 60), dtype=np.float64)
    whole = np.hypot(row - 18, column - 25) < 14
    pad = (abs(row - 18) < 6) & (abs(column - 31) < 4)
    dot = np.hypot(row - 18, column - 20) < 5
    own = np.asarray(0.1 + 0.7 * (whole & ~pad & ~dot), dtype=np.float64)
    meant = np.stack([own, 0.7 * pad, 0.7 * dot])
    used = np.ones(own.shape, dtype=np.bool_)
    light = 1 + 0.01 * (column - 25) - 0.005 * (row - 18)
    shown = light * (0.6 * own + 0.2 * meant[1] + 0.8 * meant[2]) + 0.03
    found = part_gain(shown, meant, (25.0, 18.0), used)
    assert found == pytest.approx((0.03, 0.6, 0.2, 0.8), abs=1e-4)  # converged that far
    one = PlacedGain(right=0.0, up=0.0, gain=0.6, level=0.03, faces=(0.2, 0.8))
    assert one.lights(0.1, 0.8) == pytest.approx((0.51, 0.09, 0.23, 0.65))


def test_a_background_in_the_parts_shade_tells_no_ratio() -> None:
    """Nor does light that fills less than the objective; else it is level over gain."""
    layer = Layer(
        name="part", outline=Outline(rings=(disc(12.0),)), z_um=0.0, reflectance=0.8
    )
    case = make_case("circle", {"radius_um": 12.0}, (layer,))
    case = replace(case, background=0.2, lamp_aperture=None)
    one = PlacedGain(right=0.0, up=0.0, gain=0.5, level=0.0)
    (found,) = face_ratios([[one]], case, has_black=True).values()
    assert isinstance(found, BlockEstimate)
    assert found.value == pytest.approx(0.25)
    narrow = replace(case.microscope, lamp_aperture=case.microscope.aperture / 2)
    for dark in (
        replace(case, lamp_aperture=0.1, background_z_um=-50.0),
        replace(case, microscope=narrow),
    ):
        (refused,) = face_ratios([[one]], dark, has_black=True).values()
        assert isinstance(refused, Refused)
        assert "not of one brightness" in refused.why
