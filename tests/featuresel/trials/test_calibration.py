"""A routine's own spread, made an honest one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.featuresel.trials.calibration import SigmaCalibration, calibrate


def _sure(errors: np.ndarray, spreads: np.ndarray) -> SigmaCalibration:
    found = calibrate(errors, spreads)
    assert found is not None
    return found


@pytest.mark.parametrize("count", [24, 64])
def test_later_answers_have_a_squared_error_of_one_and_are_covered(count: int) -> None:
    """A routine that knows where it is worse, but thinks itself thrice too good."""
    rng = np.random.default_rng(6)
    squares, inside = [], []
    for _ in range(2000):
        spreads = rng.uniform(0.01, 0.1, count + 1)
        errors = 0.05 + 3 * spreads * rng.normal(size=count + 1)
        found = _sure(errors[:-1], spreads[:-1])
        off, claim = errors[-1] - found.bias, float(spreads[-1])
        squares.append((off / (found.factor * claim)) ** 2)
        inside.append(abs(off) <= found.reach * claim)
    # a squared normal has a variance of 2: 4 standard errors of 2000
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 2000))
    # ceil(25 * .95) / 25 = .96 and ceil(65 * .95) / 65 = .954, less the bias' doubt
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_the_reach_holds_whatever_the_shape() -> None:
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(2000):
        errors = rng.standard_t(3, 100)
        found = _sure(errors[:-1], np.ones(99))
        inside.append(abs(errors[-1] - found.bias) <= found.reach)
    # 4 standard errors of a rate of .95
    assert np.mean(inside) == pytest.approx(0.95, abs=4 * math.sqrt(0.0475 / 2000))


def test_eighteen_answers_hold_no_interval_and_nineteen_do() -> None:
    errors = np.linspace(-1, 1, 19)
    assert math.isinf(_sure(errors[:-1], np.ones(18)).reach)
    assert _sure(errors, np.ones(19)).reach == 1.0


def test_a_spread_of_nothing_cannot_be_mended() -> None:
    assert calibrate(np.zeros(3), np.ones(3)) is None
    assert calibrate(np.zeros(9), np.zeros(9)) is None
