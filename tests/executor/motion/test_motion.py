"""Motions of the simulated cell through the executor's own gate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.executor.devices.drivers import Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES, PhaseLimit
from microplan.executor.devices.station import Station
from microplan.executor.motion.motion import Motion
from microplan.executor.simulated.axes import DriveError
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.plan import AxisMove, Region
from tests.executor.bench import quiet, world

FAR = AxisMove(axes="stage", x_um=-100.0, y_um=40.0)


def cell(*faults: str, drive: DriveError | None = None) -> Cell:
    drives = {} if drive is None else {"stage": drive}
    return build_cell(quiet(world()), 1, faults, drives=drives)


def ruled(found: Cell, **changes: object) -> Station:
    """Return the cell's station with other rules of safety."""
    rules = found.station.rules
    safety = replace(rules.safety, **changes)  # type: ignore[arg-type]  # by name
    return replace(found.station, rules=replace(rules, safety=safety))


def refused(call: Callable[[], object], code: str) -> ExecutorError:
    """Return the error of a call that must end in `code`."""
    with pytest.raises(ExecutorError) as caught:
        call()
    assert caught.value.code == code
    return caught.value


def test_a_motion_takes_its_way_and_its_dwell() -> None:
    found = cell()
    Motion().travel(found.station, FAR, "approach")
    assert found.stage.reading().x_um == -100.0
    spec, poll_s = found.truth.stage.spec, found.station.rules.safety.poll_s
    seconds = math.hypot(500.0, 40.0) / spec.speed_xy_um_per_s + spec.settle_s
    assert seconds <= found.truth.time_s <= seconds + poll_s


def test_a_drive_with_steps_ends_at_the_nearest_one() -> None:
    found = cell(drive=DriveError(quantum_um=0.08))
    Motion().travel(found.station, FAR, "approach")  # half a step is inside the window
    assert found.truth.stage.actual["x_um"] == pytest.approx(-100.0, abs=0.04)
    coarse = cell(drive=DriveError(quantum_um=0.7))
    error = refused(lambda: Motion().travel(coarse.station, FAR, "approach"), "MP845")
    assert "x_um by 0.1" in error.message  # 143 steps are 100.1 um


def test_backlash_is_lost_where_the_direction_turns() -> None:
    found = cell(drive=DriveError(backlash_um=3.0))
    places = []
    for start_um in (-700.0, -500.0):
        found.stage.move(x_um=start_um)
        Motion().travel(found.station, AxisMove(axes="stage", x_um=-600.0), "approach")
        places.append(found.truth.stage.actual["x_um"])
    assert places == pytest.approx([-601.5, -598.5])


def test_a_reading_that_lags_is_waited_for() -> None:
    found, prompt = cell(drive=DriveError(lag_s=0.5)), cell()
    for each in (found, prompt):
        Motion().travel(each.station, FAR, "approach")
    assert found.truth.time_s - prompt.truth.time_s == pytest.approx(0.5, abs=0.06)
    assert found.stage.reading().x_um == -100.0


def test_after_a_fault_everything_is_refused_with_that_fault() -> None:
    found, motion = cell("axis_stalls@a"), Motion()
    found.faults.enter("a")
    first = refused(lambda: motion.travel(found.station, FAR, "servo"), "MP846")
    found.faults.enter("b")  # the device is sound again
    before = found.stage.reading()
    for call in (
        lambda: motion.travel(found.station, FAR, "servo"),
        lambda: motion.grip(found.station, 100.0),
        lambda: motion.focus(found.station, 5.0),
        lambda: motion.zoom(found.station, 7.0),
        lambda: motion.light(found.station, 0.5),
        lambda: motion.grab(found.station, None),
    ):
        assert refused(call, "MP846") is first
    assert found.stage.reading() == before
    assert found.jaws.reading() == 130.0


@pytest.mark.parametrize(
    ("move", "phase", "code"),
    [
        (AxisMove(axes="stage", x_um=9e3), "approach", "MP840"),
        (AxisMove(axes="stage", x_um=math.nan), "approach", "MP847"),
        (AxisMove(axes="stage", x_um=0.0, speed_um_per_s=math.inf), "servo", "MP847"),
        (AxisMove(axes="stage", x_um=-500.0), "servo", "MP843"),
        (AxisMove(axes="robot", z_um=4.0), "approach", "MP842"),
        (AxisMove(axes="stage", z_um=396.0), "approach", "MP842"),
    ],
)
def test_a_move_that_is_not_allowed_is_not_begun(
    move: AxisMove, phase: str, code: str
) -> None:
    found = cell()
    station = ruled(
        found, phases={"servo": PhaseLimit(step_um=50.0)}, fingers_above_stage_um=5.0
    )
    before = found.stage.reading(), found.robot.reading()
    refused(lambda: Motion().travel(station, move, phase), code)  # type: ignore[arg-type]  # a phase
    assert (found.stage.reading(), found.robot.reading()) == before
    assert found.truth.time_s == 0.0


axis_moves = st.builds(
    AxisMove,
    axes=st.sampled_from(["stage", "robot"]),
    x_um=st.none() | st.floats(-2e4, 2e4),
    y_um=st.none() | st.floats(-2e4, 2e4),
    z_um=st.none() | st.floats(-6e3, 6e3),
    theta_rad=st.none() | st.floats(-4.0, 4.0),
    speed_um_per_s=st.none() | st.floats(2e3, 1e4),
)


def tried(station: Station, move: AxisMove) -> str | None:
    """Return the code a move ends in, None if it is made."""
    try:
        Motion().travel(station, move, "approach")
    except ExecutorError as error:
        return error.code
    return None


@settings(max_examples=25, deadline=None)
@given(moves=st.lists(axis_moves, max_size=3))
def test_no_sequence_of_moves_leaves_limits_steps_or_height(
    moves: list[AxisMove],
) -> None:
    found = cell()
    found.truth.bodies.clear()  # where axes go is asked here, not what they touch
    step_um, margin_um = 8000.0, 5.0
    station = ruled(
        found,
        phases={"approach": PhaseLimit(step_um=step_um)},
        fingers_above_stage_um=margin_um,
        poll_s=0.5,
    )
    for move in moves:
        before = station.axes(move.axes).reading()
        code = tried(station, move)
        after = station.axes(move.axes).reading()
        assert code in (None, "MP840", "MP842", "MP843")
        assert code is None or after == before
        way = [getattr(after, a) - getattr(before, a) for a in AXES[:3]]
        assert math.hypot(*way) <= step_um * (1 + 2e-5)
        for name, (low, high) in station.offer.travel.items():
            group, _, axis = name.partition(".")
            value = (found.stage if group == "stage" else found.robot).reading()
            assert low <= getattr(value, axis) <= high
        height_um = found.robot.reading().z_um - found.stage.reading().z_um
        assert height_um >= margin_um - 1e-2


def test_an_axis_may_creep_beside_one_with_a_long_way() -> None:
    """The simulated stage lets all axes arrive together: .06 um beside 3 rad."""
    found = cell()
    found.truth.bodies.clear()
    station = ruled(found, poll_s=0.5)
    move = AxisMove(axes="stage", z_um=0.0625, theta_rad=3.0)
    assert tried(station, move) is None
    assert found.stage.reading().theta_rad == pytest.approx(3.0, abs=1e-3)


class Shaky:
    """A camera that loses its first frames, or gives old ones."""

    model, serial = "shaky", "0"

    def __init__(self, lost: int, *, old: bool = False) -> None:
        self.lost, self.old, self.asked = lost, old, 0

    def grab(self, region: Region | None = None, *, after_s: float) -> Frame:
        self.asked += 1
        if self.asked <= self.lost and not self.old:
            raise TimeoutError("no frame")
        late_s = -1.0 if self.asked <= self.lost else 0.0
        return Frame(counts=np.zeros((2, 2), np.uint8), exposed_s=after_s + late_s)


@pytest.mark.parametrize("old", [False, True])
def test_a_frame_that_is_lost_or_old_is_asked_for_again(old: bool) -> None:
    station = cell().station
    for lost in (0, 1, 2):
        camera = Shaky(lost, old=old)
        Motion().grab(replace(station, camera=camera), None)
        assert camera.asked == lost + 1
    refused(
        lambda: Motion().grab(replace(station, camera=Shaky(3, old=old)), None), "MP848"
    )


def test_an_interrupt_stops_what_moves() -> None:
    found = cell()

    class Impatient:
        """A clock during whose wait Ctrl-C is hit."""

        def now_s(self) -> float:
            return found.clock.now_s()

        def wait(self, seconds: float) -> None:
            found.clock.wait(seconds)
            if found.clock.now_s() > 0.2:
                raise KeyboardInterrupt

    station = replace(found.station, clock=Impatient())
    with pytest.raises(KeyboardInterrupt):
        Motion().travel(station, FAR, "approach")
    assert not found.stage.moving()
    assert -600.0 < found.stage.reading().x_um < -100.0


def test_what_cannot_be_stopped_is_told_and_the_others_are_stopped() -> None:
    found = cell("axis_stalls")
    stopped = []

    class Deaf:
        """Jaws whose stop fails; the rest is not asked for here."""

        model, serial = "deaf", "0"

        def start(self, opening_um: float) -> None:
            raise AssertionError

        def reading(self) -> float:
            return 130.0

        def moving(self) -> bool:
            return False

        def stop(self) -> None:
            stopped.append("jaws")
            raise OSError("the port is gone")

    station = replace(found.station, gripper=Deaf())
    error = refused(lambda: Motion().travel(station, FAR, "approach"), "MP846")
    assert "NOT STOPPED: jaws.stop: OSError: the port is gone" in str(error)
    assert stopped == ["jaws"]
    assert not found.stage.moving()


def test_jaws_may_rest_on_a_part_but_must_move() -> None:
    found, motion = cell("jaws_stuck"), Motion()
    assert motion.grip(found.station, 130.0) == 130.0  # they stand there already
    refused(lambda: motion.grip(found.station, 96.0), "MP849")


class Coasting:
    """A stage that goes a little farther when it is stopped."""

    def __init__(self, found: Cell) -> None:
        self._stage, self._braking = found.stage, False

    def __getattr__(self, name: str) -> object:
        return getattr(self._stage, name)

    def stop(self) -> None:
        """Brake: the way that is left is 2 um."""
        if self._stage.moving() and not self._braking:
            self._braking = True
            self._stage.start(x_um=self._stage.reading().x_um + 2.0)


def test_what_is_stopped_is_waited_for_until_it_stands() -> None:
    found = cell()
    station = replace(found.station, stage=Coasting(found))  # type: ignore[arg-type]  # by its methods
    found.stage.start(x_um=-100.0)
    found.timeline.advance(0.05)
    stopped_um = found.stage.reading().x_um
    Motion().rest(station)
    assert not found.stage.moving()
    assert found.stage.reading().x_um == pytest.approx(stopped_um + 2.0)


def test_what_cannot_be_stopped_is_not_taken_up() -> None:
    found = cell("axis_never_ready")
    stage = replace(found.station, stage=Deaf(found))  # type: ignore[arg-type]  # as above
    found.stage.start(x_um=-100.0)
    error = refused(lambda: Motion().rest(stage), "MP841")
    assert "stage.stop: OSError: no answer" in error.message


class Deaf(Coasting):
    """A stage that does not take a stop."""

    def stop(self) -> None:
        """Fail."""
        raise OSError("no answer")


def test_a_poll_too_short_for_the_clock_ends_too() -> None:
    found = cell()
    Motion().focus(ruled(found, poll_s=1e-300), 1.0)
    assert found.station.lens.reading()[1] == pytest.approx(1.0, abs=0.1)
