"""Beliefs follow the axes, and measurements re-anchor them."""

from __future__ import annotations

import math

import pytest

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.motion.beliefs import Beliefs, Readings, stage_pose
from microplan.schemas.plan import Belief, FeaturePlace, RestAngle
from microplan.schemas.pose import Pose

AXIS = (10.0, -20.0)


def reading(
    x_um: float = 0.0, y_um: float = 0.0, theta_rad: float = 0.0
) -> AxisReading:
    return AxisReading(x_um=x_um, y_um=y_um, z_um=0.0, theta_rad=theta_rad)


def readings(stage: AxisReading, robot: AxisReading | None = None) -> Readings:
    return Readings(stage=stage, robot=robot or reading(), theta_axis_um=AXIS)


def beliefs() -> Beliefs:
    def belief(name: str, carrier: str, pose: Pose) -> Belief:
        return Belief(
            name=name,
            carrier="stage" if carrier == "stage" else "robot",
            pose=pose,
            sigma_xy_um=1.0,
            sigma_theta_rad=0.1,
        )

    return Beliefs(
        (
            belief("gear", "stage", Pose(x_um=600.0, y_um=5.0, theta_rad=0.3)),
            belief("tweezers", "robot", Pose(x_um=0.0, y_um=0.0)),
        ),
        (FeaturePlace(name="gear.bore", owner="gear", x_um=3.0, y_um=4.0),),
    )


def test_the_axis_of_a_turned_stage_stays_where_it_is() -> None:
    pose = stage_pose(reading(theta_rad=0.7), AXIS)
    assert pose.apply(*AXIS) == pytest.approx(AXIS)


def test_the_axis_travels_with_the_stage() -> None:
    pose = stage_pose(reading(100.0, 7.0, theta_rad=-1.1), AXIS)
    assert pose.apply(*AXIS) == pytest.approx((AXIS[0] + 100.0, AXIS[1] + 7.0))


def test_a_quarter_turn_of_the_stage_swings_a_part_about_the_axis() -> None:
    at = beliefs().world("gear", readings(reading(theta_rad=math.pi / 2)))
    # (600, 5) - (10, -20) = (590, 25), turned (-25, 590), back (-15, 570)
    assert (at.x_um, at.y_um) == pytest.approx((-15.0, 570.0))
    assert at.theta_rad == pytest.approx(0.3 + math.pi / 2)


def test_a_feature_sits_in_its_owners_frame() -> None:
    at = beliefs().world("gear.bore", readings(reading()))
    c, s = math.cos(0.3), math.sin(0.3)
    assert (at.x_um, at.y_um) == pytest.approx((600 + 3 * c - 4 * s, 5 + 3 * s + 4 * c))


@pytest.mark.parametrize("theta_rad", [None, 1.2])
def test_a_measurement_puts_the_feature_where_it_was_seen(
    theta_rad: float | None,
) -> None:
    known, now = beliefs(), readings(reading(-50.0, 8.0, 0.4))
    before = known.world("gear", now).theta_rad
    known.update("gear.bore", now, 12.0, -3.0, theta_rad)
    at = known.world("gear.bore", now)
    assert (at.x_um, at.y_um) == pytest.approx((12.0, -3.0))
    assert at.theta_rad == pytest.approx(before if theta_rad is None else theta_rad)


def test_an_angle_is_known_once_it_was_measured() -> None:
    anywhere = Belief(
        name="gear",
        carrier="stage",
        pose=Pose(x_um=0.0, y_um=0.0),
        sigma_xy_um=1.0,
        sigma_theta_rad=3.14159,
    )
    known, now = Beliefs((anywhere,), ()), readings(reading())
    assert not known.knows_angle("gear")
    known.update("gear", now, 0.0, 0.0, None)
    assert not known.knows_angle("gear")
    known.update("gear", now, 0.0, 0.0, 0.4)
    assert known.knows_angle("gear")


def test_a_measured_part_moves_on_with_the_stage() -> None:
    known = beliefs()
    known.update("gear", readings(reading(-600.0)), 1.0, 2.0, None)
    at = known.world("gear", readings(reading(-590.0, 5.0)))
    assert (at.x_um, at.y_um) == pytest.approx((11.0, 7.0))


def test_a_grasped_part_is_centred_across_the_jaws_and_follows_the_robot() -> None:
    known, now = beliefs(), readings(reading(-600.0), reading(0.0, 0.0))
    known.update("tweezers.grip", now, 2.0, 1.0, None)
    known.grasp("gear", "tweezers", now)
    at = known.world("gear", now)
    assert (at.x_um, at.y_um) == pytest.approx((2.0, 5.0))
    later = known.world("gear", readings(reading(), reading(10.0, 20.0)))
    assert (later.x_um, later.y_um) == pytest.approx((12.0, 25.0))
    assert known.held_by("tweezers") == ("gear",)


RESTS = tuple(
    RestAngle(theta_rad=k * math.pi / 2, across_um=(-7.0, 2.0, 7.0, -2.0)[k])
    for k in range(4)
)


def test_a_grasped_part_is_believed_at_its_rest_angle_to_the_jaws() -> None:
    """The jaws are at .4, the part at 2.05: .08 off a quarter turn between them."""
    known, now = beliefs(), readings(reading(-600.0), reading(0.0, 0.0))
    known.update("tweezers.grip", now, 2.0, 1.0, 0.4, 1e-3)
    known.update("gear", now, 3.0, 4.0, 2.05, 2e-4)
    before = known.world("tweezers", now).inverse().compose(known.world("gear", now))
    known.grasp("gear", "tweezers", now, 5.0, RESTS)
    inside = known.world("tweezers", now).inverse().compose(known.world("gear", now))
    assert inside.theta_rad == pytest.approx(math.pi / 2)
    assert (inside.x_um, inside.y_um) == pytest.approx((2.0, before.y_um))
    assert known.belief("gear").sigma_theta_rad == pytest.approx(1e-3)  # of the jaws


def test_an_angle_that_was_not_measured_is_known_no_better_between_jaws() -> None:
    """From .3 with a sigma of .1 another than 0 is beyond four sigmas."""
    known, now = beliefs(), readings(reading(-600.0))
    known.update("tweezers", now, 0.0, 0.0, 0.0, 1e-3)
    known.grasp("gear", "tweezers", now, 0.0, RESTS)
    assert known.world("gear", now).theta_rad == pytest.approx(0.0, abs=1e-12)
    assert known.belief("gear").sigma_theta_rad == pytest.approx(0.1)


def test_a_released_part_stays_on_the_stage() -> None:
    known, now = beliefs(), readings(reading(-600.0))
    known.grasp("gear", "tweezers", now)
    known.release("gear", now)
    at = known.world("gear", readings(reading(-500.0), reading(900.0, 900.0)))
    assert (at.x_um, at.y_um) == pytest.approx((100.0, 5.0))
    assert known.held_by("tweezers") == ()


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing is known of 'gera'"):
        beliefs().owner("gera")
