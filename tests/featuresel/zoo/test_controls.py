"""Routines known to be bad: as good as they can be, and kept apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.registry import REGISTRY, load

Look = Callable[[str], LookCase]
CONTROLS = ("hough", "keypoints", "phase_correlation")


def test_the_controls_are_marked_and_no_other_is() -> None:
    assert tuple(n for n in sorted(REGISTRY) if load(n).baseline) == CONTROLS


@pytest.mark.parametrize("name", ["hough", "phase_correlation"])
def test_a_post_is_found_to_a_pixel_but_no_better(
    name: str, look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look("post"), name)
    assert sample.failures == ()
    far = np.hypot(*sample.errors_um.T)
    assert far.max() < 1.5 * look("post").microscope.um_per_px
    assert np.sqrt((far**2).mean()) > 30 * sample.limit_um


def test_keypoints_cannot_tell_the_teeth_of_a_turned_gear(
    look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look("find_gear"), "keypoints", draws=10)
    right = (np.abs(sample.turns_rad) < np.radians(1)).sum()
    assert right < 10  # what finds teeth by phase and notch is right in all


def test_an_unmoved_part_is_where_keypoints_say(look: Look) -> None:
    case, routine = look("bracket"), load("keypoints")
    artifact = routine.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    at = Guess(column=case.target.column, row=case.target.row)
    found = routine.measure(nominal_render(case)(), artifact, at)
    assert isinstance(found, Measurement)
    # the same image has the same keypoints; single precision holds where they are
    assert found.column == pytest.approx(case.target.column, abs=1e-3)
    assert found.row == pytest.approx(case.target.row, abs=1e-3)
    assert found.theta_rad == pytest.approx(case.theta_rad, abs=1e-4)


def test_noise_has_no_common_phase(look: Look, expose_image: Any) -> None:
    case, routine = look("find_gear"), load("phase_correlation")
    artifact = routine.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    at = Guess(column=case.target.column, row=case.target.row)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noise = rng.uniform(0.2, 0.8, (200, 200))
        found = routine.measure(noise, artifact, at)
        assert isinstance(found, Failure)
        assert found.code in {"low_score", "outside"}
    real = routine.measure(nominal_render(case)(dx_um=2.0), artifact, at)
    assert isinstance(real, Measurement)


def test_phase_correlation_keeps_its_template(look: Look) -> None:
    case, routine = look("post"), load("phase_correlation")
    artifact = routine.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    before = artifact.arrays["template"].copy()
    at = Guess(column=case.target.column, row=case.target.row)
    image = nominal_render(case)(dx_um=2.0)
    first = routine.measure(image, artifact, at)
    second = routine.measure(image, artifact, at)
    np.testing.assert_array_equal(artifact.arrays["template"], before)
    assert not isinstance(first, Failure)
    assert first == second
