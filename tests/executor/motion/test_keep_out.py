"""Moves that would bring bodies together are refused; what may pass never collides."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely.affinity import affine_transform

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.beliefs import Beliefs, Readings
from microplan.executor.motion.keep_out import KeepOut, Moment
from microplan.executor.motion.swept_volume import (
    ROUNDING_UM,
    SweptVolume,
    Travel,
    hull,
    meets,
)
from microplan.schemas.plan import (
    AxisMove,
    Belief,
    FeaturePlace,
    GraspAction,
    InsertAction,
    MoveAction,
    Plan,
)
from microplan.schemas.plan.views import Fingers, Prism, Solid
from microplan.schemas.pose import Pose
from tests.executor.bench import plan_of, step

SAMPLES = 5  # places of each axis on its way, all combined
ANGLE = 0.7
AXIS = (40.0, -30.0)


def square(side_um: float, low_um: float, high_um: float) -> Prism:
    """Return a square prism about the origin."""
    h = side_um / 2
    return Prism(
        corners_um=((-h, -h), (h, -h), (h, h), (-h, h)), low_um=low_um, high_um=high_um
    )


def finger(side: int) -> Prism:
    """Return a finger 30 wide and 300 long, its tip 20 beyond the grip."""
    xs = sorted((0.0, 30.0 * side))
    corners = ((xs[0], -20.0), (xs[1], -20.0), (xs[1], 280.0), (xs[0], 280.0))
    return Prism(corners_um=corners, low_um=0.0, high_um=50.0)


def belief(
    name: str, x_um: float, y_um: float, *, sigma_theta_rad: float = 0.0
) -> Belief:
    """Return a part on the stage."""
    return Belief(
        name=name,
        carrier="stage",
        pose=Pose(x_um=x_um, y_um=y_um, theta_rad=0.3),
        sigma_xy_um=0.0,
        sigma_theta_rad=sigma_theta_rad,
    )


def job(x_um: float = 200.0, y_um: float = 0.0) -> Plan:
    """Return a plan with a block, a block with a post at (x, y), and a tool."""
    tool = Belief(
        name="tool",
        carrier="robot",
        pose=Pose(x_um=0.0, y_um=0.0),
        sigma_xy_um=0.0,
        sigma_theta_rad=0.0,
    )
    return replace(
        plan_of(
            (
                step(
                    "grasp", GraspAction(target="ring.hole", tool="tool", opening_um=60)
                ),
                step("carry", MoveAction()),
                step("insert", InsertAction(target="ring", onto="base.post", moves=())),
                step("away", MoveAction()),
            )
        ),
        beliefs=(belief("ring", 0.0, 0.0), belief("base", x_um, y_um), tool),
        features=(
            FeaturePlace(name="ring.hole", owner="ring", x_um=0.0, y_um=0.0),
            FeaturePlace(name="base.post", owner="base", x_um=0.0, y_um=0.0),
        ),
        parts=(
            Solid(name="base", prisms=(square(120, 0, 30), square(24, 30, 130))),
            Solid(name="ring", prisms=(square(60, 0, 40),)),
        ),
        fingers=(Fingers(tool="tool", left=finger(-1), right=finger(1)),),
    )


def at(x_um: float, y_um: float, z_um: float, theta_rad: float = 0.0) -> AxisReading:
    return AxisReading(x_um=x_um, y_um=y_um, z_um=z_um, theta_rad=theta_rad)


def moment(
    plan: Plan,
    stage: AxisReading,
    robot: AxisReading,
    openings_um: tuple[float, ...] = (80.0,),
    *,
    held: bool = False,
) -> Moment:
    """Return where everything is; a held ring sits between the jaws."""
    readings = Readings(stage=stage, robot=robot, theta_axis_um=AXIS)
    beliefs = Beliefs(plan.beliefs, plan.features)
    if held:
        beliefs.grasp("ring", "tool", readings)
    return Moment(beliefs=beliefs, readings=readings, openings_um=openings_um)


def moved(prism: Prism, pose: Pose) -> shapely.Polygon:
    """Return a prism's polygon at a pose, by shapely's own road."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    corners = shapely.Polygon(prism.corners_um)
    return affine_transform(corners, [c, -s, s, c, pose.x_um, pose.y_um])


def truly_meets(
    plan: Plan, now: Moment, move: AxisMove, samples: int = SAMPLES
) -> bool:
    """Return whether bodies overlap in any sampled place between a move's ends.

    Every axis goes its way on its own: all combinations of places are tried.
    """
    start = now.readings.reading(move.axes)
    axes = ("x_um", "y_um", "z_um", "theta_rad")
    ways = []
    for name in axes:
        first, last = getattr(start, name), getattr(move, name)
        same = last is None or last == first
        ways.append([first] if same else np.linspace(first, last, samples).tolist())
    for values in itertools.product(*ways):
        reading = AxisReading(**dict(zip(axes, values, strict=True)))
        stage = reading if move.axes == "stage" else now.readings.stage
        robot = reading if move.axes == "robot" else now.readings.robot
        readings = replace(now.readings, stage=stage, robot=robot)
        if overlap(plan, replace(now, readings=readings)):
            return True
    return False


def overlap(plan: Plan, now: Moment) -> bool:
    """Return whether anything on the robot overlaps anything on the stage."""
    robot, stage = bodies(plan, now, "robot"), bodies(plan, now, "stage")
    for (shape, low, high), (other, below, above) in itertools.product(robot, stage):
        deep = min(high, above) - max(low, below)
        # deeper than what counts as touching
        if deep > 2 * ROUNDING_UM and shape.buffer(-2 * ROUNDING_UM).intersects(other):
            return True
    return False


def bodies(
    plan: Plan, now: Moment, axes: str
) -> list[tuple[shapely.Polygon, float, float]]:
    """Return what an axis group carries: polygon, least and greatest height."""
    found = []
    for solid in plan.parts:
        known = now.beliefs.belief(solid.name)
        if known.carrier == axes:
            under = now.readings.reading(known.carrier).z_um + known.z_um
            pose = now.beliefs.world(solid.name, now.readings)
            found += [
                (moved(p, pose), under + p.low_um, under + p.high_um)
                for p in solid.prisms
            ]
    if axes == "robot" and now.readings.robot is not None:
        z_um = now.readings.robot.z_um
        grip = now.beliefs.world("tool", now.readings)
        for prism, side in ((plan.fingers[0].left, -1), (plan.fingers[0].right, 1)):
            place = grip.compose(Pose(x_um=side * now.openings_um[0] / 2, y_um=0.0))
            found.append(
                (moved(prism, place), z_um + prism.low_um, z_um + prism.high_um)
            )
    return found


near = st.floats(-250.0, 250.0)
height = st.floats(-60.0, 160.0)
turn = st.floats(-1.2, 1.2)
maybe = st.one_of(st.none(), near)


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(near, near, height, turn),
    st.tuples(near, near, height, turn),
    st.sampled_from(["stage", "robot"]),
    st.tuples(maybe, maybe, st.one_of(st.none(), height), st.one_of(st.none(), turn)),
    st.booleans(),
)
@example((0, 0, 0, 0), (0, 0, 200, 0), "robot", (None, None, 10.0, None), False)
@example((0, 0, 0, 0), (0, 0, 200, 0), "stage", (None, None, 190.0, None), True)
def test_a_move_that_passes_never_truly_collides(
    stage: tuple[float, ...],
    robot: tuple[float, ...],
    axes: str,
    to: tuple[float | None, ...],
    held: bool,
) -> None:
    plan = job()
    now = moment(plan, at(*stage), at(*robot), held=held)
    move = AxisMove(
        axes="stage" if axes == "stage" else "robot",
        x_um=to[0],
        y_um=to[1],
        z_um=to[2],
        theta_rad=to[3],
    )
    if KeepOut(plan, -1e9).met(move, now) is None:
        assert not truly_meets(plan, now, move)


def test_a_clear_move_passes_and_the_same_one_lower_does_not() -> None:
    plan, across = job(), AxisMove(axes="robot", x_um=300.0)
    keep = KeepOut(plan, 0.0)
    for z_um, refused in ((131.0, False), (129.0, True)):  # the post is 130 high
        now = moment(plan, at(0, 0, 0), at(-100, 0, z_um))
        met = keep.met(across, now)
        assert (met is not None) == refused
        assert truly_meets(plan, now, across, 41) == refused
        if met is not None:
            assert set(met) == {"tool", "base"}


def test_a_gap_is_kept_to_a_hundredth_and_a_margin_is_added() -> None:
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2.0]])
    one = SweptVolume(owner="a", corners_um=square, low_um=0.0, high_um=1.0)
    for gap_um in (-0.02, 0.0, 3.0):
        other = replace(one, corners_um=one.corners_um + (2.0 + gap_um, 0.0))
        assert meets(one, other) == (gap_um < -ROUNDING_UM)
        assert meets(one, other, margin_um=2.9) == (gap_um < 2.9)
        assert meets(one, other, margin_um=3.1)
    above = replace(one, low_um=1.0, high_um=2.0)
    assert not meets(one, above)
    assert meets(one, replace(above, low_um=0.5))


@pytest.mark.parametrize("way_rad", [0.01, 1.0, -4.0, 9.0, -20.0])
def test_what_a_turn_covers_holds_every_place_between(way_rad: float) -> None:
    corners = np.array([[90.0, -5.0], [130.0, -5.0], [130.0, 8.0]])
    room = SweptVolume(owner="a", corners_um=corners, low_um=0.0, high_um=1.0)
    travel = Travel(start=at(0, 0, 0), end=at(0, 0, 0, way_rad), pivot_um=AXIS)
    covered = shapely.union_all(
        [shapely.Polygon(each.corners_um) for each in travel.covered(room)]
    )
    for angle in np.linspace(0.0, way_rad, 41).tolist():
        turned = shapely.affinity.rotate(
            shapely.Polygon(corners), angle, origin=AXIS, use_radians=True
        )
        assert covered.buffer(1e-6).contains(turned)


def test_a_turn_without_end_is_a_whole_one() -> None:
    corners = np.array([[90.0, -5.0], [130.0, -5.0], [130.0, 8.0]])
    room = SweptVolume(owner="a", corners_um=corners, low_um=0.0, high_um=1.0)
    travel = Travel(start=at(0, 0, 0), end=at(0, 0, 0, 1e308), pivot_um=AXIS)
    assert len(list(travel.covered(room))) == 72  # of 5 deg


def test_the_hull_is_that_of_shapely() -> None:
    rng = np.random.default_rng(3)
    points = np.round(rng.normal(size=(60, 2)), 1)  # many on lines
    ours = shapely.Polygon(hull(points))
    theirs = shapely.MultiPoint(points).convex_hull
    assert ours.symmetric_difference(theirs).area < 1e-9
    assert ours.exterior.is_ccw


def test_a_part_and_its_seat_may_touch_from_the_insertion_on() -> None:
    plan = job(x_um=0.0)
    now = moment(plan, at(0, 0, 0), at(0, 0, 0))
    now.beliefs.grasp("ring", "tool", now.readings)
    low = replace(now.readings, stage=at(0, 0, -200.0))
    now = replace(now, readings=low, openings_um=(160.0,))  # clear of post and base
    up, keep = AxisMove(axes="stage", z_um=-60.0), KeepOut(plan, -1e9)
    with pytest.raises(ExecutorError, match="base would meet ring") as refused:
        keep.check(up, now, "carry")
    assert refused.value.code == "MP836"
    keep.check(up, now, "insert")
    keep.check(up, now, "away")


def test_jaws_may_close_on_what_they_grasp_alone() -> None:
    plan = job()
    keep = KeepOut(plan, 0.0)
    now = moment(plan, at(0, 0, 0), at(0, 0, 10), (80.0, 50.0))
    keep.check_jaws(now, "grasp")
    with pytest.raises(ExecutorError, match="tool would meet ring"):
        keep.check_jaws(now, "")
    beside = moment(plan, at(-80, 0, 0), at(0, 0, 10), (80.0, 160.0))
    with pytest.raises(ExecutorError, match="tool would meet base"):
        keep.check_jaws(beside, "grasp")


def test_a_held_part_may_leave_the_surface_and_not_go_into_it() -> None:
    plan = job(x_um=900.0)
    now = moment(plan, at(0, 0, 0), at(0, 0, 10), held=True)
    keep = KeepOut(plan, 0.0)
    keep.check(AxisMove(axes="stage", z_um=-5.0), now, "carry")
    keep.check(AxisMove(axes="robot", z_um=15.0), now, "carry")
    for axes, z_um in (("stage", 5.0), ("robot", 5.0)):
        move = AxisMove(axes="stage" if axes == "stage" else "robot", z_um=z_um)
        with pytest.raises(ExecutorError, match="ring would meet the stage"):
            keep.check(move, now, "carry")
        keep.check(move, now, "insert")


def test_a_part_at_an_unknown_angle_takes_up_its_whole_circle() -> None:
    plan = job(x_um=900.0)
    anyhow = (belief("ring", 0, 0, sigma_theta_rad=math.pi), *plan.beliefs[1:])
    # turned by .3 rad its corners reach to 37.5, at any angle to 42.4
    for beliefs, refused in ((plan.beliefs, False), (anyhow, True)):
        told = replace(plan, beliefs=beliefs)
        now = moment(told, at(0, 0, 0), at(0, 0, 10), (82.0,))
        met = KeepOut(told, 0.0).met(AxisMove(axes="robot", z_um=0.0), now)
        assert (met is not None) == refused


def test_a_room_without_a_belief_is_refused() -> None:
    with pytest.raises(ExecutorError) as refused:
        KeepOut(replace(job(), beliefs=()), 0.0)
    assert refused.value.code == "MP802"


def test_a_target_that_is_no_number_is_refused_as_such() -> None:
    now = moment(job(), at(0, 0, 0), at(0, 0, 200))
    with pytest.raises(ExecutorError) as refused:
        KeepOut(job(), 0.0).check(AxisMove(axes="robot", x_um=math.nan), now, "")
    assert refused.value.code == "MP847"


def test_a_plan_that_tells_no_room_lets_everything_pass() -> None:
    plan = replace(job(), parts=(), fingers=())
    now = moment(plan, at(0, 0, 0), at(0, 0, 10))
    assert KeepOut(plan, 0.0).met(AxisMove(axes="robot", x_um=300.0), now) is None


def test_few_moves_are_refused_without_need() -> None:
    rng, plan = np.random.default_rng(0), job()
    keep, told = KeepOut(plan, -1e9), {"passed": 0, "needless": 0, "refused": 0}
    for _ in range(60):
        places = [
            at(
                rng.uniform(-250, 250),
                rng.uniform(-250, 250),
                rng.uniform(-60, 160),
                rng.uniform(-1.2, 1.2),
            )
            for _ in range(3)
        ]
        now = moment(plan, places[0], places[1], held=bool(rng.integers(2)))
        to = {
            name: getattr(places[2], name)
            for name in ("x_um", "y_um", "z_um", "theta_rad")
            if rng.random() < 0.5
        }
        move = AxisMove(axes="stage" if rng.integers(2) else "robot", **to)
        collides = truly_meets(plan, now, move)
        if keep.met(move, now) is None:
            assert not collides
            told["passed"] += 1
        else:
            told["refused" if collides else "needless"] += 1
    assert told["passed"] > 30
    assert told["refused"] > 10
    assert told["needless"] <= 3
