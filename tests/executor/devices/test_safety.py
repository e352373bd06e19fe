"""The rules for motions, without any device."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import (
    AXES,
    MotionProgress,
    PhaseLimit,
    Rules,
    Safety,
    Settle,
    Speeds,
    check_fingers,
    check_finite,
    check_step,
    check_travel,
)
from microplan.schemas.plan import AxisMove

HOME = AxisReading(x_um=0.0, y_um=0.0, z_um=0.0, theta_rad=0.0)
SETTLE = Settle(window_um=0.1, window_rad=1e-4, dwell_s=0.1, timeout_s=5.0, stall_s=1.0)
WIDE = st.floats(-1e6, 1e6)


def code_of(call: object) -> str:
    """Return the code of an error that a call raised."""
    assert isinstance(call, pytest.ExceptionInfo)
    error = call.value
    assert isinstance(error, ExecutorError)
    return error.code


@given(low=WIDE, span=st.floats(1e-3, 1e6), value=WIDE)
def test_what_is_let_through_is_inside_the_limits(
    low: float, span: float, value: float
) -> None:
    travel = {"stage.x_um": (low, low + span)}
    slack = 1e-5 * max(abs(low), abs(low + span))
    inside = low - slack <= value <= low + span + slack
    with nullcontext() if inside else pytest.raises(ExecutorError, match="is outside"):
        check_travel("stage", {"x_um": value}, travel)


def test_an_axis_that_the_station_has_not_is_refused() -> None:
    with pytest.raises(ExecutorError, match=r"no axis robot.z_um") as caught:
        check_travel("robot", {"z_um": 0.0}, {})
    assert code_of(caught) == "MP840"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused(value: float) -> None:
    check_finite("stage", {"x_um": 0.0})
    with pytest.raises(ExecutorError, match=r"stage.y_um is") as caught:
        check_finite("stage", {"x_um": 0.0, "y_um": value})
    assert code_of(caught) == "MP847"


@pytest.mark.parametrize(
    ("move", "what"),
    [
        (AxisMove(axes="stage", x_um=3.0, y_um=4.0, z_um=12.0), "step of 13 um"),
        (AxisMove(axes="stage", theta_rad=-0.2), "turn of 0.2 rad"),
        (AxisMove(axes="stage", x_um=1.0, speed_um_per_s=80.0), "speed of 80 um/s"),
    ],
)
def test_a_step_turn_or_speed_beyond_its_phase_is_refused(
    move: AxisMove, what: str
) -> None:
    limit = PhaseLimit(step_um=12.9, step_rad=0.19, speed_um_per_s=79.0)
    with pytest.raises(ExecutorError, match=what) as caught:
        check_step(move, HOME, "servo", limit)
    assert code_of(caught) == "MP843"
    check_step(move, HOME, "servo", PhaseLimit())
    more = PhaseLimit(step_um=13.0, step_rad=0.2, speed_um_per_s=80.0)
    check_step(move, HOME, "servo", more)


def test_fingers_keep_their_margin_but_in_close_phases() -> None:
    safety = Safety(fingers_above_stage_um=5.0, close_phases=("insert",))
    check_fingers(105.0, 100.0, "approach", safety)
    check_fingers(100.0, 100.0, "insert", safety)
    for height_um, phase in ((104.0, "approach"), (99.0, "insert")):
        with pytest.raises(ExecutorError, match="above the stage") as caught:
            check_fingers(height_um, 100.0, phase, safety)  # type: ignore[arg-type]  # both are phases
        assert code_of(caught) == "MP842"


def test_the_speed_ordered_is_asked_slowest_or_the_phases() -> None:
    own = Speeds(xy_um_per_s=1000.0, z_um_per_s=500.0, theta_rad_per_s=1.0)
    limits = {"insert": PhaseLimit(speed_um_per_s=50.0)}
    rules = Rules(stage_speeds=own, safety=Safety(phases=limits))  # type: ignore[arg-type]  # a phase
    assert rules.speed("stage", "approach", None) is None
    assert rules.speed("stage", "insert", None) == 50.0
    assert rules.speed("stage", "insert", 20.0) == 20.0
    fast = {"insert": PhaseLimit(speed_um_per_s=800.0)}
    rules = replace(rules, safety=Safety(phases=fast))  # type: ignore[arg-type]  # a phase
    assert rules.speed("stage", "insert", None) == 500.0  # z goes no faster for it


@given(
    away=st.floats(1.0, 1e4),
    samples=st.integers(3, 40),
    axis=st.sampled_from(AXES),
)
def test_an_axis_that_comes_closer_is_never_stopped(
    away: float, samples: int, axis: str
) -> None:
    watch = MotionProgress(HOME, {axis: away}, SETTLE)
    for i in range(samples + 1):
        reading = replace(HOME, **{axis: away * i / samples})
        watch.check("stage", reading, 0.9 * i)  # up to .9 s between two readings
    back = replace(HOME, **{axis: -1.0})
    with pytest.raises(ExecutorError) as caught:  # it was watched all the time
        watch.check("stage", back, 0.9 * samples)
    assert code_of(caught) == "MP846"


def test_an_axis_that_stands_goes_back_or_was_not_told_is_stopped() -> None:
    for told, reading, why in (
        ({"x_um": 10.0}, replace(HOME, x_um=-0.3), "wrong way"),
        ({"x_um": 10.0}, replace(HOME, y_um=0.3), "not told to"),
    ):
        with pytest.raises(ExecutorError, match=why) as caught:
            MotionProgress(HOME, told, SETTLE).check("stage", reading, 0.0)
        assert code_of(caught) == "MP846"
    watch = MotionProgress(HOME, {"x_um": 10.0}, SETTLE)
    for now_s, x_um in ((0.0, 4.0), (0.9, 4.0), (1.0, 4.005)):
        watch.check("stage", replace(HOME, x_um=x_um), now_s)  # .005 is noise
    with pytest.raises(ExecutorError, match=r"come closer for 1.1 s") as caught:
        watch.check("stage", replace(HOME, x_um=4.0), 1.1)


def test_an_overshoot_is_no_wrong_way() -> None:
    watch = MotionProgress(HOME, {"x_um": 10.0}, SETTLE)
    for now_s, x_um in ((0.0, 0.0), (0.1, 9.95), (0.2, 12.0), (0.3, 9.0), (0.4, 10.0)):
        watch.check("stage", replace(HOME, x_um=x_um), now_s)
    with pytest.raises(ExecutorError, match="wrong way") as caught:
        watch.check("stage", replace(HOME, x_um=-0.3), 0.5)
    assert code_of(caught) == "MP846"
