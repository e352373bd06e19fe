"""What a response that is not stated may move, against the profile of an edge."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import prepare
from microplan.optics.outline.outline import Outline
from microplan.optics.transfer.otf import diffraction
from microplan.planner.looks.edge_shifts.response_shift import (
    MOST_SHIFT,
    POWERS,
    response_rows,
    response_shift,
)
from tests.optics.shapes import disc

CHAIN = ("circle_caliper",)
AREA = ("otsu",)


def profile(x: float) -> float:
    """Return light over an edge from 0 to 1, x in wavelengths over aperture."""

    def slope(f: float) -> float:
        return float(diffraction(np.array(f / 2))) * np.sinc(2 * f * x) * 2 * x

    return 0.5 + float(quad(slope, 0.0, 2.0, limit=200)[0])


def test_a_full_edge_moves_by_the_most() -> None:
    """The middle of counts lies where the light is one half to the power 1 / p."""
    moved = [
        abs(brentq(lambda x, p=p: profile(x) - 0.5 ** (1 / p), -0.5, 0.5))
        for p in POWERS
    ]
    assert max(moved) == pytest.approx(MOST_SHIFT, abs=0.005)
    assert max(moved) <= MOST_SHIFT


def test_the_centre_of_a_circle_stays(post: LookCase) -> None:
    found = response_shift(post, prepare(post, [CHAIN]), CHAIN, root_seed=1)
    assert found.um < 0.005  # of edges that move by .05 um


def test_a_target_with_a_blurred_side_moves(post: LookCase) -> None:
    """Two discs that touch: between them light does not fall to the ground's.

    Their common outline's middle moves by less than an edge does.
    """
    two = Outline(rings=(*disc(9.0, (-9.2, 0.0)).rings, *disc(22.0, (22.2, 0.0)).rings))
    moving = (replace(post.moving[0], outline=two),)
    case = replace(
        post, moving=moving, target=with_contour(replace(post.target), [two])
    )
    found = response_shift(case, prepare(case, [AREA]), AREA, root_seed=1)
    scope = case.microscope
    assert 0 < found.um < MOST_SHIFT * scope.wavelength_um / scope.aperture


def test_the_row_says_what_was_tried_and_a_stated_response_has_none(
    post: LookCase,
) -> None:
    found = response_shift(post, prepare(post, [CHAIN]), CHAIN, root_seed=1)
    (row,) = response_rows(post, found, is_stated=False)
    assert row.level == "charged"
    assert row.predicted_error is not None
    assert row.predicted_error >= 1000 * found.um
    assert "0.7 and 1.4" in row.reason
    assert response_rows(post, found, is_stated=True) == ()
    assert math.isfinite(row.predicted_error)
