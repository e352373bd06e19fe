"""Aberrations as lines of a workcell, and in words."""

from __future__ import annotations

import numpy as np
import yaml

from microplan.planner.calibration.calibrated_value import PictureSource
from microplan.planner.calibration.estimates import BlockEstimate, VectorEstimate
from microplan.planner.calibration.through_focus.wavefront_fit import (
    WavefrontFit,
    WavefrontTerm,
)
from microplan.planner.calibration.through_focus.wavefront_values import (
    wavefront_values,
    wavefront_words,
)

SOURCE = PictureSource(pictures=9, sha256="0")


def term(noll: int, waves: float) -> WavefrontTerm:
    found = BlockEstimate(value=waves, sigma=2e-4, method="edges", blocks=9)
    return WavefrontTerm(noll=noll, waves=found, better=0.1)


def fit(*terms: WavefrontTerm) -> WavefrontFit:
    numbers = VectorEstimate(
        values=np.zeros(3), covariance=None, method="edges", blocks=9
    )
    return WavefrontFit(terms=terms, dropped=(term(5, 1e-4),), numbers=numbers)


def test_terms_are_a_line_by_their_indices() -> None:
    (value,) = wavefront_values(
        fit(term(11, 0.03), term(8, -0.02)), SOURCE, has_rms=False
    )
    assert value.where == ("optics", "wavefront")
    assert yaml.safe_load(value.line) == [
        {"noll": 8, "waves": -0.02, "sigma_waves": 2e-4},
        {"noll": 11, "waves": 0.03, "sigma_waves": 2e-4},
    ]
    assert value.record["standard_deviation"] == [2e-4, 2e-4]
    words = list(wavefront_words(fit(term(8, -0.02)), has_rms=False))
    assert "coma along x (Noll 8): -0.0200 +- 0.0002 waves rms" in words[0]
    assert words[-1] == "not told from none, waves rms: Noll 5 +0.0001 +- 0.0002"


def test_no_term_is_no_line() -> None:
    assert not list(wavefront_values(fit(), SOURCE, has_rms=False))


def test_a_total_that_is_stated_leaves_terms_no_room() -> None:
    found = fit(term(8, -0.02))
    (value,) = wavefront_values(found, SOURCE, has_rms=True)
    assert value.where is None
    said = "optics.wavefront_rms is stated: put the terms in its place"
    assert said in list(wavefront_words(found, has_rms=True))
