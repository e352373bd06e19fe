"""The better models of effects that the plan of few trials does not charge."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.look.perturb import as_tried
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.sampling import BAND_ERROR, Sampling
from microplan.planner.looks.model_errors.better_models import (
    BetterModel,
    better_models,
    flat,
)
from microplan.planner.task.workcell import WavefrontSpec
from tests.featuresel.conftest import between_fingers


def look() -> LookCase:
    """Return a look whose band is cut, as trials cut it."""
    return replace(between_fingers(), sampling=Sampling(band_error=5e-3))


def only(*effects: str) -> BetterModel:
    """Return the one better model of some effects of a look."""
    lens = WavefrontSpec(terms=None, rms_waves=0.0)
    (found,) = better_models(look(), effects, (), lens)
    assert found.effects == effects
    return found


def test_the_law_is_compared_with_the_exact_one_in_its_whole_band() -> None:
    found = only("defocus law", "band and tile")
    ((weight, better),) = found.ends[0].cases
    assert found.against is not None
    assert (weight, better.model) == (1.0, "exact")
    assert found.against.model == look().model != "exact"
    assert better.sampling.band_error == BAND_ERROR < found.against.sampling.band_error


def test_a_vectorial_field_is_two_scalar_ones_of_the_same_light() -> None:
    found = only("vectorial field")
    (outer, inner) = found.ends[0].cases
    plain = flat(look())  # rays know no waves
    assert found.against == outer[1]
    assert outer[1] == replace(plain, sampling=replace(plain.sampling, rays=0.0))
    assert outer[0] + inner[0] == pytest.approx(1.0, abs=1e-12)
    assert inner[1].microscope.aperture < outer[1].microscope.aperture


def test_what_bodies_hide_and_shade_is_traced() -> None:
    found = only("layers of different height")
    assert found.ends[0].is_traced
    assert found.against == flat(as_tried(look()))
