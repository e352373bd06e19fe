"""A verification of an angle: what it measures, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.measure_target import TargetSighting
from microplan.executor.run.verify import check_turn
from microplan.schemas.plan import VerifyAction

ACTION = VerifyAction(
    target="die", on="submount.mark", look="a", seat_look="b", within_um=1.0,
    height=None, empty=None, within_rad=0.01,
)  # fmt: skip


def seen(theta_rad: float | None) -> TargetSighting:
    return TargetSighting(
        features={},
        target="die", x_um=0.0, y_um=0.0, theta_rad=theta_rad, score=1.0,
        spread_um=0.1, sigma_theta_rad=None, routines=("ncc",), frames=1,
    )  # fmt: skip


@pytest.mark.parametrize("turn_rad", [-0.0099, 0.0, 0.0099])
@pytest.mark.parametrize("seat_rad", [0.3, -3.14, 3.14])
def test_a_small_turn_passes_whichever_way_both_lie(
    turn_rad: float, seat_rad: float
) -> None:
    part = seen(math.remainder(seat_rad + turn_rad, math.tau))
    found = check_turn(ACTION, 0.01, part, seen(seat_rad))
    assert found == pytest.approx(turn_rad, abs=1e-12)


@pytest.mark.parametrize("turn_rad", [-0.0101, 0.0101, math.pi, math.nan])
def test_a_larger_turn_is_refused(turn_rad: float) -> None:
    with pytest.raises(ExecutorError) as caught:
        check_turn(ACTION, 0.01, seen(0.3 + turn_rad), seen(0.3))
    assert caught.value.code == "MP856"


@pytest.mark.parametrize("blind", ["part", "seat"])
def test_an_angle_that_nobody_measured_is_no_pass(blind: str) -> None:
    part = seen(None if blind == "part" else 0.0)
    seat = replace(seen(0.0), theta_rad=None if blind == "seat" else 0.0)
    with pytest.raises(ExecutorError) as caught:
        check_turn(ACTION, 0.01, part, seat)
    assert caught.value.code == "MP824"
