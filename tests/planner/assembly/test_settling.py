"""Where a part's angle settles between jaws, against drawn starts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from microplan.planner.assembly.settling import settling

NINE = tuple(math.radians(20 * k + 10) for k in range(9))  # as an 18-tooth gear has
UNEVEN = (0.1, 0.9, 2.2)
DRAWS = 40_000


@pytest.mark.parametrize("minima", [NINE, UNEVEN, (0.0, math.pi / 2)])
@pytest.mark.parametrize("sigma_rad", [0.05, 0.3, 1.5])
@pytest.mark.parametrize("theta_rad", [-4.0, 0.0, 0.33, 3.0])
def test_where_a_turn_settles_agrees_with_draws(
    minima: tuple[float, ...], sigma_rad: float, theta_rad: float
) -> None:
    rng = np.random.default_rng(7)
    turns = np.array([m + k * math.pi for k in range(-8, 9) for m in minima])
    starts = np.append(theta_rad, rng.normal(theta_rad, sigma_rad, DRAWS))
    ends = turns[np.abs(starts[:, None] - turns).argmin(axis=1)]
    squares = (ends[1:] - ends[0]) ** 2
    found = settling(minima, theta_rad, sigma_rad)
    # five standard errors of the mean square, and what a draw can tell from nothing
    atol = 5 * squares.std() / math.sqrt(DRAWS) + 1 / DRAWS
    assert found.sigma_rad**2 == pytest.approx(squares.mean(), abs=atol)
    away = (ends[1:] != ends[0]).mean()
    rough = 5 * math.sqrt(away * (1 - away) / DRAWS) + 1 / DRAWS
    assert found.elsewhere[0] == pytest.approx(away, abs=rough)


@given(theta_rad=st.floats(-7, 7))
def test_a_known_turn_settles_in_one_minimum(theta_rad: float) -> None:
    first, second, *_ = sorted(
        abs(math.remainder(theta_rad - m, math.pi)) for m in UNEVEN
    )
    assume(second - first > 1e-9)  # halfway between two minima it may fall into either
    assert settling(UNEVEN, theta_rad, 0.0).sigma_rad == 0.0
    assert settling((0.4,), theta_rad, 1e-3).sigma_rad <= math.pi
