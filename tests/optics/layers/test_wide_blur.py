"""Layers that are blurred widely, from few points, against transforms of all pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.optics.layers.wide_blur import cover_few
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer
from tests.optics.shapes import gear, microscope, rectangle

OPTICS = microscope(6.9, 90, 70)
TRIALS = Sampling(planes=True)


def layer(outline: Outline, z_um: float) -> Layer:
    return Layer(name="body", outline=outline, z_um=z_um, reflectance=0.5)


@pytest.mark.parametrize("z_um", [-300.0, -90.0, 120.0])
@pytest.mark.parametrize("outline", [gear(), rectangle(-20.0, -400.0, 300.0, 15.0)])
def test_few_points_show_what_a_transform_does(outline: Outline, z_um: float) -> None:
    body = layer(place(outline, 9.3, -4.1, 0.3), z_um)
    (few,) = cover_few([body], OPTICS, focus_um=0.0, sampling=TRIALS)
    fine = Sampling(band_error=1e-6, margin=300.0)
    (true,) = cover([body], OPTICS, focus_um=0.0, sampling=fine)
    assert np.ptp(true.coverage) > 0.005
    np.testing.assert_allclose(few.coverage, true.coverage, rtol=0, atol=3e-3)


def test_near_focus_and_in_fine_bands_it_is_the_transform() -> None:
    fine = replace(TRIALS, band_error=1e-6)
    for z_um, sampling in ((8.0, TRIALS), (120.0, fine), (120.0, Sampling())):
        bodies = [layer(gear(), z_um)]
        (few,) = cover_few(bodies, OPTICS, focus_um=0.0, sampling=sampling)
        (true,) = cover(bodies, OPTICS, focus_um=0.0, sampling=sampling)
        np.testing.assert_array_equal(few.coverage, true.coverage)


def test_a_moving_body_changes_its_blur_smoothly() -> None:
    """Second differences of steps of .05 um are far below first ones."""
    seen = np.array(
        [
            cover_few(
                [layer(place(gear(), x_um, 0.0, 0.0), 120.0)], OPTICS,
                focus_um=0.0, sampling=TRIALS,
            )[0].coverage
            for x_um in np.arange(9) * 0.05
        ]
    )  # fmt: skip
    first, second = np.diff(seen, axis=0), np.diff(seen, 2, axis=0)
    assert np.sqrt(np.mean(second**2)) < 0.2 * np.sqrt(np.mean(first**2))
