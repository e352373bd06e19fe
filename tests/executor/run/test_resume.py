"""What a resumed run decides from the readings."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import Rules
from microplan.executor.record.recovery import ResumeState
from microplan.executor.record.write_ahead_log import DriveReadings, Intent
from microplan.executor.run.resume import decide

RULES = Rules()
BEFORE = DriveReadings(
    stage=AxisReading(x_um=10.0, y_um=20.0, z_um=-260.0, theta_rad=0.1),
    robot=AxisReading(x_um=0.0, y_um=0.0, z_um=30.0, theta_rad=0.0),
    opening_um=130.0,
)


def left(device: str = "stage", **target: float) -> ResumeState:
    """Return what is left of a run that died in a motion."""
    intent = Intent(
        step="insert",
        name="insert 1",
        device=device,  # type: ignore[arg-type]  # one of three
        target=target,
        phase="insert",
        irreversible=True,
        before=BEFORE,
    )
    return ResumeState(opened=intent, standing=BEFORE)


def stage(**axes: float) -> DriveReadings:
    return replace(BEFORE, stage=replace(BEFORE.stage, **axes))


def jaws(opening_um: float) -> DriveReadings:
    return replace(BEFORE, opening_um=opening_um)


@pytest.mark.parametrize(
    ("now", "was"),
    [
        (stage(z_um=0.0), "done"),
        (stage(z_um=-0.04), "done"),  # in the window of .05 um
        (stage(z_um=-0.06), "on the way"),
        (stage(z_um=-130.0), "on the way"),
        (stage(z_um=-259.8), "on the way"),
        (stage(z_um=-259.95), "not begun"),
        (BEFORE, "not begun"),
    ],
)
def test_readings_tell_how_far_a_motion_went(now: DriveReadings, was: str) -> None:
    assert decide(left(z_um=0.0), now, RULES) == was


@pytest.mark.parametrize(
    ("now", "was"),
    [(jaws(96.2), "done"), (jaws(98.5), "on the way"), (jaws(129.5), "not begun")],
)
def test_jaws_that_rest_on_a_part_may_be_on_the_way(
    now: DriveReadings, was: str
) -> None:
    assert decide(left("jaws", opening_um=96.0), now, RULES) == was


@pytest.mark.parametrize(
    ("now", "told"),
    [
        (stage(z_um=1.0), "stage.z_um reads 1, it was at -260, and was sent to 0"),
        (stage(z_um=-261.0), "stage.z_um reads -261"),
        (stage(x_um=10.2), "stage.x_um reads 10.2, it was at 10"),
        (stage(theta_rad=0.2), "stage.theta_rad reads 0.2"),
        (jaws(96.0), "jaws.opening_um reads 96, it was at 130"),
        (replace(BEFORE, robot=None), "it had"),
    ],
)
def test_what_stands_elsewhere_is_refused(now: DriveReadings, told: str) -> None:
    with pytest.raises(ExecutorError) as caught:
        decide(left(z_um=0.0), now, RULES)
    assert caught.value.code == "MP865"
    assert caught.value.message.startswith(told)


def test_between_two_motions_everything_stands_as_it_did() -> None:
    state = ResumeState(standing=BEFORE)
    assert decide(state, BEFORE, RULES) == "not begun"
    with pytest.raises(ExecutorError) as caught:
        decide(state, stage(z_um=-259.0), RULES)
    assert caught.value.code == "MP865"


@given(st.floats(0, 1), st.floats(-500, 500), st.floats(-500, 500))
def test_a_place_on_the_way_is_never_refused_and_never_both(
    share: float, x_um: float, y_um: float
) -> None:
    state = left(x_um=x_um, y_um=y_um)
    now = stage(x_um=10.0 + share * (x_um - 10.0), y_um=20.0 + share * (y_um - 20.0))
    was = decide(state, now, RULES)
    far = max(abs(x_um - 10.0), abs(y_um - 20.0))
    window_um = RULES.stage.window_um
    if was == "done":
        assert (1 - share) * far <= window_um + 1e-9
    elif was == "not begun":
        assert share * far <= 2 * window_um + 1e-9
    else:
        assert (1 - share) * far >= window_um - 1e-9
