"""Waves of a sampled pupil against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.optics.layers.diffraction.pupil_grid import (
    FAR,
    SIDE,
    carry,
    level,
    places,
    pupil,
    transfer,
)
from microplan.optics.transfer.otf import diffraction

HEIGHTS = (-60.0, -FAR, -3.0, 0.0, 1e-3, 7.0, 13.0, 90.0)


@pytest.mark.parametrize("height", HEIGHTS)
def test_all_light_of_the_pupil_passes_every_height(height: float) -> None:
    assert pupil().sum() == pytest.approx(1, abs=1e-6)
    assert level(height).power.sum() == pytest.approx(1, abs=1e-5)  # single precision


@pytest.mark.parametrize("end", HEIGHTS)
def test_a_wave_carried_down_is_the_one_that_the_pupil_sends(end: float) -> None:
    for start in HEIGHTS:
        found = carry(level(start).whole, level(start), level(end))
        np.testing.assert_allclose(
            found, level(end).whole, rtol=0, atol=1e-5 * np.abs(found).max()
        )


def test_a_wave_in_focus_has_the_transfer_of_a_circular_pupil() -> None:
    """The overlap of two pupils, whose rims are cells of 1 / 32."""
    along = transfer()[0, : SIDE // 2]  # shifts of 0, 1 / 32 ... of the rim
    expected = diffraction(np.minimum(np.arange(SIDE // 2) / 64, 1.0))
    np.testing.assert_allclose(along, expected, rtol=0, atol=1 / 64)


def test_a_blurred_point_is_a_disc_of_its_geometrical_radius() -> None:
    """Near focus by place: the mean square of the radius is height**2 / 2."""
    found = level(8.0)
    square = places()[:, None] ** 2 + places() ** 2
    inside = square < 12**2  # beyond, it is of the pupil's hard rim
    mean = (found.power * square)[inside].sum() / found.power[inside].sum()
    assert mean == pytest.approx(8.0**2 / 2, rel=0.03)
