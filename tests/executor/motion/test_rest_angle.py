"""Where closing jaws turn a part, against drawn starts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.motion.rest_angle import squeezed
from microplan.schemas.plan import RestAngle

DRAWS = 40_000


def rests(*half_turn_rad: float) -> tuple[RestAngle, ...]:
    """Return rest angles and those half a turn on; the origin lies 3 um off."""
    return tuple(
        RestAngle(theta_rad=turn + k * math.pi, across_um=3.0 * (-1) ** k)
        for k in (0, 1)
        for turn in half_turn_rad
    )


SQUARE = rests(0.0, math.pi / 2)
UNEVEN = rests(0.1, 0.9, 2.2)


@pytest.mark.parametrize("angles", [SQUARE, UNEVEN, rests(0.4)])
@pytest.mark.parametrize("sigma_rad", [0.02, 0.3, 0.8])
@pytest.mark.parametrize("theta_rad", [-4.0, 0.0, 0.33, 3.0])
def test_where_jaws_turn_a_part_agrees_with_draws(
    angles: tuple[RestAngle, ...], sigma_rad: float, theta_rad: float
) -> None:
    turns = np.array([r.theta_rad + k * math.tau for k in range(-3, 4) for r in angles])
    starts = np.random.default_rng(5).normal(theta_rad, sigma_rad, DRAWS)
    ends = turns[np.abs(starts[:, None] - turns).argmin(axis=1)]
    nearest = turns[np.abs(theta_rad - turns).argmin()]
    found = squeezed(angles, theta_rad, sigma_rad)
    assert found.theta_rad == pytest.approx(nearest)
    away = (ends != nearest).mean()
    # five standard errors, and what a draw can tell from nothing
    rough = 5 * math.sqrt(away * (1 - away) / DRAWS) + 1 / DRAWS
    assert found.elsewhere == pytest.approx(away, abs=rough)
    squares = (ends - nearest) ** 2
    atol = 5 * squares.std() / math.sqrt(DRAWS) + 1 / DRAWS
    assert found.sigma_rad**2 == pytest.approx(squares.mean(), abs=atol)


@given(theta_rad=st.floats(-7, 7), off_rad=st.floats(-0.7, 0.7))
def test_a_known_angle_ends_at_the_nearest_rest(
    theta_rad: float, off_rad: float
) -> None:
    rest_rad = round(theta_rad / (math.pi / 2)) * math.pi / 2
    found = squeezed(SQUARE, rest_rad + off_rad, 0.0)
    assert found.theta_rad == pytest.approx(rest_rad, abs=1e-12)
    assert found.across_um == 3.0 * (-1) ** (round(rest_rad / (math.pi / 2)) % 4 // 2)
    assert (found.sigma_rad, found.elsewhere) == (0.0, 0.0)


def test_midway_between_two_rests_either_is_as_likely() -> None:
    found = squeezed(SQUARE, math.pi / 4, 1e-3)
    assert found.elsewhere == pytest.approx(0.5)
    assert found.sigma_rad == pytest.approx(math.pi / 2 * math.sqrt(0.5))


def test_a_part_without_rest_angles_is_refused() -> None:
    with pytest.raises(ValueError, match="must hold an angle"):
        squeezed((), 0.0, 0.1)
