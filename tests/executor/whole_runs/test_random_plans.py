"""Random whole plans: whatever they ask for, devices are never told to do harm."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from microplan.executor.devices.drivers import AxisReading, Counts
from microplan.executor.devices.errors import CODES
from microplan.executor.devices.safety import AXES, Phase, PhaseLimit
from microplan.executor.devices.station import Station
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.outcome import RunResult
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.plan import (
    AlignAction,
    AxisMove,
    GraspAction,
    InsertAction,
    LocateAction,
    MoveAction,
    Region,
    ReleaseAction,
    Step,
)
from tests.executor.bench import control, plan_of, stage_to, step
from tests.executor.disc import PictureCamera, disc, look, noisy, rig_of
from tests.executor.recorder import Call, Recorder

T = TypeVar("T")

LIMITS: dict[Phase, PhaseLimit] = {
    "approach": PhaseLimit(step_um=4000.0, step_rad=2.0, speed_um_per_s=3000.0),
    "servo": PhaseLimit(step_um=40.0, step_rad=0.1, speed_um_per_s=500.0),
    "insert": PhaseLimit(step_um=300.0, step_rad=0.0, speed_um_per_s=50.0),
    "retreat": PhaseLimit(step_um=6000.0, step_rad=0.0, speed_um_per_s=5000.0),
}
MARGIN_UM = 5.0  # of the fingers over the stage
ORDERS = ("start", "start_magnification", "start_focus_um", "set_level", "grab")
# Numbers come in six digits: `microplan.executor.devices.safety.ROUNDING` of the
# largest, 1e4 um.
SLACK = 1.1e-5

# A plan holds finite numbers only: its reader sees to that.
awkward = st.sampled_from([1e308, -1e308, 5e-324, -0.0, 0.0, 1e-9])


def warm_start(most: float) -> st.SearchStrategy[float]:
    """Return numbers of which some are allowed, some are not and some are none."""
    return st.floats(-most, most) | st.floats(-most / 50, most / 50) | awkward


def mostly(
    sound: st.SearchStrategy[T], wild: st.SearchStrategy[T]
) -> st.SearchStrategy[T]:
    """Return what is allowed five times in six, so that plans come far."""
    return st.one_of(sound, sound, sound, sound, sound, wild)


wild_moves = st.builds(
    AxisMove,
    axes=st.sampled_from(["stage", "robot"]),
    x_um=st.none() | warm_start(6e3),
    y_um=st.none() | warm_start(6e3),
    z_um=st.none() | warm_start(1.5e3),
    theta_rad=st.none() | warm_start(3.0),
    speed_um_per_s=st.none() | warm_start(4e3),
)
stage_moves = st.builds(
    AxisMove,
    axes=st.just("stage"),
    x_um=st.none() | st.floats(-1000.0, 200.0),
    y_um=st.none() | st.floats(-400.0, 400.0),
    z_um=st.none() | st.floats(-300.0, 20.0) | st.floats(0.0, 60.0),
    speed_um_per_s=st.none() | st.floats(10.0, 3000.0),
)
robot_moves = st.builds(
    AxisMove,
    axes=st.just("robot"),
    y_um=st.none() | st.floats(0.0, 3500.0),
    z_um=st.none() | st.floats(30.0, 600.0) | st.floats(0.0, 60.0),
)
gentle_moves = st.builds(
    AxisMove,
    axes=st.just("stage"),
    z_um=st.floats(-300.0, 20.0),
    speed_um_per_s=st.floats(1.0, 50.0),
)
several = st.lists(mostly(stage_moves | robot_moves, wild_moves), max_size=2).map(tuple)
inserting = st.lists(mostly(gentle_moves, wild_moves), max_size=2).map(tuple)
openings = mostly(st.floats(80.0, 200.0), warm_start(300.0))
controls = mostly(
    st.builds(
        control,
        gain=st.floats(0.3, 1.2),
        tolerance_xy_um=st.floats(0.1, 3.0),
        max_step_um=st.floats(20.0, 100.0),
        max_cycles=st.integers(1, 6),
    ),
    st.builds(
        control,
        method=st.sampled_from(["servo", "look_then_move"]),
        gain=warm_start(10.0),
        tolerance_xy_um=awkward,
        max_step_um=awkward,
        max_cycles=st.integers(0, 6),
    ),
)


@st.composite
def steps(draw: st.DrawFn) -> tuple[Step, ...]:
    """Return up to six steps in any order, each with moves of its own."""
    found = []
    for number in range(draw(st.integers(1, 6))):
        name, moves = f"step-{number}", draw(several)
        verb = draw(
            st.sampled_from(["move", "locate", "align", "grasp", "insert", "release"])
        )
        if verb == "move":
            found.append(step(name, MoveAction(), moves=moves))
        elif verb == "locate":
            action = LocateAction(target="gear", look="disc")
            found.append(step(name, action, looks=(look()[0],), moves=moves))
        elif verb == "align":
            path = draw(st.sampled_from([("xy",), ("x", "y"), ("y", "x")]))
            align = AlignAction(
                target="gear", to="goal", look="disc", axes="stage", path=path
            )
            found.append(
                step(name, align, looks=(look()[0],), moves=moves, servo=draw(controls))
            )
        elif verb == "grasp":
            grasp = GraspAction(
                target="gear", tool="tweezers", opening_um=draw(openings)
            )
            found.append(step(name, grasp, moves=moves))
        elif verb == "insert":
            insert = InsertAction(
                target="gear.bore", onto="shaft_plate.post", moves=draw(inserting)
            )
            found.append(step(name, insert, moves=moves))
        else:
            release = ReleaseAction(
                target="gear", tool="tweezers", opening_um=draw(openings)
            )
            found.append(step(name, release, moves=moves))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """An order to an axis group, what it is for, and where the group was then."""

    call: Call
    phase: Phase
    before: AxisReading
    robot_over_stage_um: float  # when it was given, with its target


class Watching(Recorder):
    """A recorder that notes where both groups are when one is sent off."""

    def __init__(self, cell: Cell) -> None:
        super().__init__()
        self.cell = cell
        self.at: list[tuple[AxisReading, AxisReading]] = []

    def station(self, found: Station) -> Station:
        """Return a station whose devices are noted, and its axes' readings with it."""
        noted = super().station(found)
        for group in (noted.stage, noted.robot):
            start = group.start  # type: ignore[union-attr]  # the cell has a robot

            def begin(start: object = start, **named: float | None) -> None:
                self.at.append((self.cell.stage.reading(), self.cell.robot.reading()))
                start(**named)  # type: ignore[operator]  # a device's method

            group.start = begin  # type: ignore[union-attr,method-assign]
        return noted


def station_of(cell: Cell) -> tuple[Station, Watching]:
    """Return the cell's station with limits by phase, a drawn camera and a recorder.

    Where axes go is asked here, not what they touch: the parts are out of the way, but
    the gear is shown where the stage would have carried it.
    """
    gear = cell.truth.bodies.pop("gear")
    cell.truth.bodies.clear()

    def show(region: Region | None) -> Counts:
        pose = cell.truth.pose(gear)
        counts: Counts = np.rint(255 * disc(pose.x_um, pose.y_um)).astype(np.uint8)
        return counts

    rules = cell.station.rules
    safety = replace(
        rules.safety, phases=LIMITS, fingers_above_stage_um=MARGIN_UM, poll_s=0.5
    )
    recorder = Watching(cell)
    station = replace(
        cell.station,
        camera=PictureCamera(show),
        rules=replace(rules, safety=safety),
    )
    return recorder.station(station), recorder


def perform(found: tuple[Step, ...]) -> tuple[RunResult, Cell, Watching]:
    """Run the steps on the simulated axes, lens and jaws."""
    cell = build_cell(noisy(1.0), 1)
    plain = rig_of(cell, look()[1])  # its beliefs have the goal
    goal = plain.beliefs
    station, recorder = station_of(cell)

    def enter(name: str) -> None:
        recorder.step = name

    rig = Rig(
        plan=replace(plan_of(found), steps=found),
        station=station,
        beliefs=Beliefs(goal._owners.values(), goal._features.values()),
        artifacts=look()[1],
        journal=Journal(io.StringIO(), station.clock),
        frames=Frames(None),
        on_step=enter,
        view=plain.view,
        probed=plain.probed,
    )
    return run_plan(rig), cell, recorder


def orders(found: tuple[Step, ...], recorder: Watching) -> Iterator[Order]:
    """Yield the orders to axes, each with the phase that the manual gives it."""
    at = iter(recorder.at)
    after_release = False
    for each in found:
        phase: Phase = "approach"
        if each.verb == "move" and after_release:
            phase = "retreat"
        after_release = each.verb == "release" or phase == "retreat"
        given, looked = 0, False
        for call in (c for c in recorder.calls if c.step == each.id):
            looked = looked or call.method == "grab"
            if call.method != "start" or call.device == "jaws":
                continue
            now: Phase = phase
            if given >= len(each.moves):
                now = "insert" if each.verb == "insert" else "approach"
                now = "servo" if looked else now
            given += 1
            stage, robot = next(at)
            ends = {"stage": stage.z_um, "robot": robot.z_um}
            asked = call.values.get("z_um")
            if asked is not None:
                ends[call.device] = asked
            yield Order(
                call=call,
                phase=now,
                before=stage if call.device == "stage" else robot,
                robot_over_stage_um=ends["robot"] - ends["stage"],
            )


def check_order(order: Order, cell: Cell) -> None:
    """Hold one order against limits, steps, speeds and the fingers' height."""
    limit, values = LIMITS[order.phase], order.call.values
    target = {a: v for a, v in values.items() if a in AXES and v is not None}
    for axis, value in target.items():
        assert math.isfinite(value), order
        low, high = cell.station.offer.travel[f"{order.call.device}.{axis}"]
        assert low - SLACK * abs(low) <= value <= high + SLACK * abs(high), order
    away = {a: abs(v - getattr(order.before, a)) for a, v in target.items()}
    turn_rad = away.pop("theta_rad", 0.0)
    assert math.hypot(*away.values()) <= limit.step_um * (1 + SLACK), order
    assert turn_rad <= limit.step_rad * (1 + SLACK), order
    speed = values.get("speed_um_per_s")
    assert speed is None or 0 < speed <= limit.speed_um_per_s * (1 + SLACK), order
    if "z_um" in target:
        least = 0.0 if order.phase == "insert" else MARGIN_UM
        assert order.robot_over_stage_um >= least - SLACK * 1e3, order


def check_once(found: tuple[Step, ...], recorder: Recorder) -> None:
    """The jaws go once a step at most, and an insertion makes each move once."""
    for each in found:
        calls = [c for c in recorder.calls if c.step == each.id and c.method == "start"]
        jaws = [c for c in calls if c.device == "jaws"]
        assert len(jaws) <= (each.verb in ("grasp", "release"))
        if isinstance(each.action, InsertAction):
            asked = [*each.moves, *each.action.moves]
            made = [c for c in calls if c.device != "jaws"]
            assert [c.device for c in made] == [m.axes for m in asked[: len(made)]]


def check_end(result: RunResult, cell: Cell, recorder: Recorder) -> None:
    """After a fault come stops alone; everything stands inside its limits."""
    names = [c.method for c in recorder.calls]
    faults = [r for r in result.steps if r.code is not None]
    if faults:
        assert faults == [result.steps[-1]]
        assert faults[0].code in CODES
        first = names.index("stop")
        assert set(names[first:]) == {"stop"}
        stopped = {c.device for c in recorder.calls[first:]}
        assert stopped == {"stage", "robot", "jaws", "lens"}
    else:
        assert "stop" not in names
    for device in (cell.stage, cell.robot, cell.jaws, cell.lens):
        assert not device.moving()
    for name, (low, high) in cell.station.offer.travel.items():
        group, _, axis = name.partition(".")
        reading = (cell.stage if group == "stage" else cell.robot).reading()
        assert low <= getattr(reading, axis) <= high


def overflowing() -> tuple[Step, ...]:
    """Return an alignment whose first correction is no number that a double holds."""
    servo = control(gain=1e308, tolerance_xy_um=1e-3, max_step_um=1e308)
    action = AlignAction(
        target="gear", to="goal", look="disc", axes="stage", path=("xy",)
    )
    beside = step("beside", MoveAction(), moves=(stage_to(x_um=-590.0),))
    aligned = step("align", action, looks=(look()[0],), servo=servo)
    return (beside, aligned)


def test_a_correction_that_is_no_number_is_a_fault_and_no_bug() -> None:
    result, cell, recorder = perform(overflowing())
    assert result.code == "MP847"
    check_end(result, cell, recorder)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(found=steps())
def test_no_plan_leaves_limits_steps_or_height_and_nothing_is_done_twice(
    found: tuple[Step, ...],
) -> None:
    result, cell, recorder = perform(found)
    made = list(orders(found, recorder))
    assert len(made) == len(recorder.at)
    for order in made:
        check_order(order, cell)
    check_once(found, recorder)
    check_end(result, cell, recorder)
    low, high = cell.station.offer.opening_um or (0.0, 0.0)
    for call in recorder.calls:
        assert call.method in (*ORDERS, "stop")
        if call.device == "jaws" and call.method == "start":
            assert low * (1 - SLACK) <= call.values["0"] <= high * (1 + SLACK)
