"""Moments of an angle's density against a fine grid and what must be exact."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.angle_density import (
    angle_density,
    angle_moments,
)
from microplan.schemas.plan.verdicts import TurnRow


def angle_of(left: float, cut: float, rest: float) -> AngleError:
    rows = (TurnRow(term="angle", sigma_rad=rest, source="test"),)
    return AngleError(left_rad=left, cut_rad=cut, rows=rows)


def whole(angle: AngleError, middle: float, count: int = 5) -> list[np.ndarray]:
    cuts = (-math.pi, -1.0, 0.0, 0.25, math.pi)
    return [angle_moments(angle, middle, *pair, count) for pair in pairwise(cuts)]


@settings(max_examples=60, deadline=None)
@given(
    st.floats(1e-6, 0.3), st.floats(0.01, 3.0), st.floats(0.01, 100.0),
    st.floats(-0.5, 0.5),
)  # fmt: skip
def test_panels_of_the_circle_hold_all_of_an_angle(
    left: float, cut_shares: float, rest_shares: float, middle: float
) -> None:
    angle = angle_of(left, cut_shares * left, min(rest_shares * left, 0.3))
    total = sum(float(found[0]) for found in whole(angle, middle))
    assert total == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    "angle",
    [
        angle_of(0.0, math.inf, 0.02),
        angle_of(0.05, 0.04, 0.004),
        angle_of(0.3, math.inf, 0.7),
        angle_of(0.0, math.inf, 4.0),  # any angle
    ],
)
def test_moments_are_those_of_the_density(angle: AngleError) -> None:
    low, high, middle = -0.1, 0.15, 0.01
    turns = low + (np.arange(200_000) + 0.5) / 200_000 * (high - low)
    law = angle_density(angle, middle, turns) * (high - low) / 200_000
    share = (2 * turns - low - high) / (high - low)
    found = angle_moments(angle, middle, low, high, 4)
    powers = [share**0, share, 2 * share**2 - 1, 4 * share**3 - 3 * share]
    np.testing.assert_allclose(found, [law @ each for each in powers], atol=1e-9)


def test_a_hard_cut_is_met_exactly() -> None:
    """Without a rest the density is cut off: half of it lies on either side."""
    angle = angle_of(0.05, 0.03, 0.0)
    left, right = (angle_moments(angle, 0.0, *ends, 1)[0] for ends in ((-1, 0), (0, 1)))
    assert (left, right) == pytest.approx((0.5, 0.5), abs=1e-12)
    assert angle_moments(angle, 0.0, 0.03, 1.0, 3).tolist() == [0.0] * 3


def test_nothing_is_found_far_from_the_middle() -> None:
    angle = angle_of(0.0, math.inf, 1e-3)
    assert angle_moments(angle, 0.0, 0.01, 1.0, 3).tolist() == [0.0] * 3
