"""What cutting the band costs, against images of all of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.sampling import Sampling, band_cut
from tests.optics.shapes import disc, microscope, one_layer, polygon, rectangle


def _error(
    outline: Outline, magnification: float, z_um: float, allowed: float
) -> float:
    """Return the largest error that a cut band makes."""
    optics, scene = microscope(magnification, 61, 61), one_layer(outline)
    assert band_cut("exact", optics, z_um, allowed) < 1
    whole, cut = (
        render(scene, optics, focus_um=z_um, sampling=Sampling(band_error=error))
        for error in (1e-12, allowed)
    )
    return float(np.abs(whole - cut).max())


@pytest.mark.parametrize("allowed", [5e-3, 5e-4])
@pytest.mark.parametrize("z_um", [0.0, 5.0])
@pytest.mark.parametrize("magnification", [6.9, 20.0, 44.5])
def test_edges_corners_and_slots_keep_the_prediction(
    magnification: float, z_um: float, allowed: float
) -> None:
    edge = rectangle(-2000.0, -2000.0, 2000.0, 0.1)
    corner = polygon([(0.0, 0.0), (400.0, 30.0), (380.0, 420.0)])
    slot = rectangle(-2000.0, -0.8, 2000.0, 0.8)
    for outline in (edge, corner, slot):
        assert _error(outline, magnification, z_um, allowed) < allowed


def test_the_middle_of_a_circle_exceeds_it() -> None:
    # as the docstring of `band_error` says
    found = _error(disc(2.0), 20.0, 0.0, 5e-3)
    assert found == pytest.approx(1.75 * 5e-3, rel=0.01)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["band_error", "margin", "near"])
def test_samplings_that_cannot_be_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Sampling(**{name: value})  # type: ignore[arg-type]  # one of the numbers
