"""Images through focus from shared spectra against images rendered anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import Trial, design
from microplan.featuresel.look.focus_series import one_by_one, posed, through_focus
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.lens.sensor import Sensor
from tests.featuresel.sharing import FINE, SHARED

Look = Callable[[str], LookCase]


def _trials(case: LookCase, dz_um: float) -> list[Trial]:
    """Return trials at two places, in nominal light and zoom."""
    return [
        replace(
            trial,
            dz_um=dz_um,
            magnification=1.0,
            gain=1.0,
            gradient_x=0.0,
            gradient_y=0.0,
            model=case.model,
        )
        for trial in design(case, 2, 5)
    ]


@pytest.mark.parametrize("name", ["find_gear", "post"])
def test_images_through_focus_are_those_rendered_anew(look: Look, name: str) -> None:
    # so many electrons that noise is below a count
    quiet = Sensor(full_well_e=1e13, read_noise_e=0.0, bits=16)
    case = replace(look(name), sensor=quiet, sampling=FINE)
    assert case.shares_spectra
    pictures = through_focus(case, _trials(case, -40.0)[0])
    for dz_um in (-1.0, -16.0, -40.0):
        trials = _trials(case, dz_um)
        for trial, found in zip(trials, pictures(trials), strict=True):
            atol = SHARED + 2 / quiet.top_count  # both are rounded to whole counts
            np.testing.assert_allclose(found, image(case, trial), rtol=0, atol=atol)


def test_bodies_of_several_heights_share_no_spectra(look: Look) -> None:
    assert not look("between").shares_spectra


@pytest.mark.parametrize(("dz_um", "zoom"), [(-16.0, 1.0), (0.0, 1.03)])
def test_images_of_a_pose_are_those_rendered_anew(
    look: Look, dz_um: float, zoom: float
) -> None:
    """In coaxial light too, whose shades are read between points."""
    quiet = Sensor(full_well_e=1e13, read_noise_e=0.0, bits=16)
    case = replace(look("between"), sensor=quiet, sampling=FINE, lamp_aperture=0.3)
    farthest = [replace(t, magnification=zoom) for t in _trials(case, dz_um)]
    pictures = posed(case, farthest[0])
    assert pictures is not None
    for share in (0.5, 1.0):
        trials = [
            replace(t, dz_um=share * t.dz_um, magnification=1 + share * (zoom - 1))
            for t in farthest
        ]
        for trial, found in zip(trials, pictures(trials), strict=True):
            atol = SHARED + 2 / quiet.top_count
            np.testing.assert_allclose(found, image(case, trial), rtol=0, atol=atol)


def test_images_one_by_one_are_those_of_the_trials(look: Look) -> None:
    case = look("between")
    trials = [*design(case, 1, 5)] * 2
    for found in one_by_one(case, trials):
        np.testing.assert_array_equal(found, image(case, trials[0]))


def test_noise_is_that_of_the_trial(look: Look) -> None:
    case = look("post")
    trials = _trials(case, 8.0)
    pictures = through_focus(case, trials[0])
    first, again = list(pictures(trials)), list(pictures(trials))
    np.testing.assert_array_equal(first, again)
    other = [replace(trial, seed=(*trial.seed, 1)) for trial in trials]
    assert not np.array_equal(first[0], next(pictures(other)))
