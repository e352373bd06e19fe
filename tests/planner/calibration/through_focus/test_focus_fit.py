"""Aperture, zero and step of a focus come out of blurred edges, or are refused."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.special import erf

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.through_focus.focus_fit import FocusFit, fit_focus
from microplan.planner.calibration.through_focus.focus_step import FocusStep

ACROSS = np.linspace(-8, 8, 33)
TRUE = (0.4, 0.7, 1.03)  # aperture, zero, scale
READINGS = np.linspace(-6.0, 7.0, 11).tolist()


def edge(defocus_um: float, aperture: float) -> FloatArray:
    """Return an edge blurred by a Gaussian: .5 / A, and A times the defocus."""
    width = math.hypot(0.5 / aperture, aperture * defocus_um)
    return np.asarray(0.5 - 0.5 * erf(ACROSS / width / math.sqrt(2)))


def steps(
    readings: Sequence[float], *, noise: float = 2e-3, seed: int = 0
) -> list[FocusStep]:
    """Return profiles of other light, contrast and place each."""
    rng = np.random.default_rng(seed)
    found = []
    aperture, zero, scale = TRUE
    for z_um in readings:
        true = edge(scale * (z_um - zero), aperture)
        light = rng.uniform(0.5, 0.9) * true + rng.uniform(0.02, 0.1)
        light = light + 0.05 * rng.normal() * np.gradient(true)
        found.append(
            FocusStep(z_um=z_um, profile=light + rng.normal(0, noise, len(true)))
        )
    return found


def refused(some: Sequence[FocusStep]) -> str:
    found = fit_focus(some, edge, 0.42)
    assert isinstance(found, Refused)
    assert "on both sides of the sharpest" in found.take
    return found.why


def test_numbers_come_out_within_their_deviations() -> None:
    """The mean square of pulls of 8 free numbers is 8/6; that of 9 by two thirds."""
    pulls = []
    for seed in range(3):
        found = fit_focus(steps(READINGS, seed=seed), edge, 0.42)
        assert isinstance(found, FocusFit)
        for one, true in zip(
            (found.aperture, found.zero_um, found.scale), TRUE, strict=True
        ):
            assert one.sigma
            pulls.append((one.value - true) / one.sigma)
        assert found.rms == pytest.approx(2e-3 / 0.7, rel=0.4)
    assert np.max(np.abs(pulls)) < 5
    assert 0.2 < np.mean(np.square(pulls)) < 4


def test_a_scale_is_worth_it_where_readings_are_no_travel() -> None:
    found = fit_focus(steps(READINGS, noise=1e-4), edge, 0.42)
    assert isinstance(found, FocusFit)
    assert found.held_out[1] < found.held_out[0]


def test_five_steps_have_no_deviation() -> None:
    found = fit_focus(steps(READINGS[1:10:2]), edge, 0.42)
    assert isinstance(found, FocusFit)
    assert found.aperture.sigma is None


def test_steps_that_do_not_tell_aperture_from_focus_are_refused() -> None:
    assert "4 focus readings, 5 are needed" in refused(steps(READINGS[::3]))
    assert "0 focus readings" in refused([])
    assert "1 focus readings" in refused(steps([3.0] * 9))
    assert "0 readings below the sharpest" in refused(steps(np.arange(1, 9.0).tolist()))
    assert "0 above it" in refused(steps(np.arange(-9, 1.0).tolist()))
    near = steps(np.linspace(0.6, 0.8, 9).tolist(), noise=0.05)
    assert "the aperture is" in refused(near) or "sharpest" in refused(near)


def test_an_aperture_at_the_end_of_what_is_tried_is_refused() -> None:
    for within in ((0.1, 0.38), (0.42, 0.9)):
        found = fit_focus(steps(READINGS), edge, 0.4, within)
        assert isinstance(found, Refused)
        assert "is the end of what is tried" in found.why
        assert "numerical_aperture" in found.take


def test_profiles_that_no_aperture_changes_are_refused() -> None:
    found = fit_focus(steps(READINGS), lambda z_um, _: edge(z_um, 0.4), 0.42)
    assert isinstance(found, Refused)
    assert "the aperture is 0.42" in found.why
