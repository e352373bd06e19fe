"""Looks of a servo against its law, drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.planner.budget.probability.servo_landing import Loop, expected_looks

RUNS = 20_000


def drawn(loop: Loop, seed: int) -> float:
    """Return the looks of the law itself, on average: landings and looks are drawn."""
    rng = np.random.default_rng(seed)

    def two(sigma: float) -> np.ndarray:
        return sigma * rng.standard_normal((left.size, 2))

    left = np.arange(RUNS)
    readings = two(math.sqrt(loop.start_um**2 - loop.move_um**2))
    looks = 0
    while left.size:
        looks += left.size
        seen = readings + two(loop.move_um) + two(loop.look_um)
        outside = np.hypot(*seen.T) > loop.within_um
        left = left[outside]
        readings = readings[outside] - loop.gain * seen[outside]
    return looks / RUNS


@pytest.mark.parametrize("gain", [0.3, 0.8, 1.0, 1.4])
@pytest.mark.parametrize("within", [0.8, 1.45, 3.0])
@pytest.mark.parametrize("start", [1.5, 6.0])
def test_expected_looks_are_those_of_the_law(
    gain: float, within: float, start: float
) -> None:
    loop = Loop(gain=gain, move_um=1.0, look_um=0.3, start_um=start, within_um=within)
    looks = drawn(loop, seed=3)
    # one sigma of the mean is below the looks' own / sqrt(RUNS), as of a geometric law
    noise = 4 * looks / math.sqrt(RUNS)
    share = 0.05 if gain <= 1 else 0.08  # as the function says
    assert expected_looks(loop) == pytest.approx(looks, rel=share, abs=noise)


def test_a_far_start_costs_what_shrinking_it_takes() -> None:
    """Without any scatter each look leaves 1 - g of the way."""
    loop = Loop(gain=0.5, move_um=0.0, look_um=0.0, start_um=1.0, within_um=1e-3)
    rng = np.random.default_rng(4)
    way = np.hypot(*rng.standard_normal((2, 200_000)))
    looks = 1 + np.ceil(np.maximum(np.log(way / 1e-3) / math.log(2), 0))
    assert expected_looks(loop) == pytest.approx(looks.mean(), rel=0.12)


@pytest.mark.parametrize(
    ("loop", "looks"),
    [
        (Loop(gain=0.8, move_um=0, look_um=0, start_um=0, within_um=1), 1.0),
        (Loop(gain=0.8, move_um=0, look_um=0, start_um=0, within_um=0), 1.0),
        (Loop(gain=0.8, move_um=1, look_um=0, start_um=1, within_um=1e9), 1.0),
        (Loop(gain=0.8, move_um=1, look_um=0, start_um=2, within_um=0), math.inf),
        (Loop(gain=1.0, move_um=1e-300, look_um=0, start_um=9, within_um=1), None),
    ],
)
def test_extremes(loop: Loop, looks: float | None) -> None:
    found = expected_looks(loop)
    if looks is None:
        assert 1 <= found < 3
    else:
        assert found == looks
