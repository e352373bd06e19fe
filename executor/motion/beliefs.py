"""Beliefs: the poses that parts or tools are thought to have.

A belief is a pose in its carrier's frame: on the stage, the world at stage reading 0;
on the robot, the grip as the reading gives it. Measurements re-anchor beliefs, moves of
the axes carry them along.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from microplan.arrays import Point
from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.rest_angle import Squeezed, squeezed
from microplan.featuresel.routines.fusion import Believed
from microplan.schemas.plan import AxesName, Belief, FeaturePlace, RestAngle
from microplan.schemas.pose import Pose

ANY_ANGLE_RAD = 3.0  # a plan says pi for "any"; six digits of it are less than pi


def stage_pose(reading: AxisReading, axis_um: Point) -> Pose:
    """Return the world pose of the stage's frame: rotated about `axis_um`, shifted.

    The axis is a world point at reading 0 and travels with the stage.
    """
    turn = Pose(x_um=0.0, y_um=0.0, theta_rad=reading.theta_rad)
    x_um, y_um = turn.apply(-axis_um[0], -axis_um[1])
    return Pose(
        x_um=reading.x_um + axis_um[0] + x_um,
        y_um=reading.y_um + axis_um[1] + y_um,
        theta_rad=reading.theta_rad,
    )


def grip_pose(reading: AxisReading) -> Pose:
    """Return the world pose of the grip for a robot reading."""
    return Pose(x_um=reading.x_um, y_um=reading.y_um, theta_rad=reading.theta_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """Both groups' readings at one moment; `robot` is None on a cell without one."""

    stage: AxisReading
    robot: AxisReading | None
    theta_axis_um: Point

    def carrier(self, name: AxesName) -> Pose:
        """Return the world pose of a carrier's frame."""
        if name == "stage":
            return stage_pose(self.stage, self.theta_axis_um)
        if self.robot is None:
            raise ValueError("there is no robot to carry anything")
        return grip_pose(self.robot)

    def reading(self, name: AxesName) -> AxisReading:
        """Return one group's readings.

        Raises
        ------
        ExecutorError
            MP808 if there is no robot.
        """
        now = self.stage if name == "stage" else self.robot
        if now is None:
            raise ExecutorError("MP808", "the plan moves a robot, the station has none")
        return now


@dataclass(frozen=True, slots=True, kw_only=True)
class BeliefRecord:
    """Snapshot of all beliefs at one moment."""

    owners: tuple[Belief, ...]
    held: Mapping[str, str]  # part -> tool


class Beliefs:
    """The one changing record of where things are thought to be."""

    def __init__(
        self, beliefs: Iterable[Belief], features: Iterable[FeaturePlace]
    ) -> None:
        self._owners = {b.name: b for b in beliefs}
        self._features = {f.name: f for f in features}
        self._held: dict[str, str] = {}  # part -> tool

    def known(self) -> BeliefRecord:
        """Return all that is believed now."""
        return BeliefRecord(owners=tuple(self._owners.values()), held=dict(self._held))

    def restore(self, known: BeliefRecord) -> None:
        """Believe what `known` holds, and nothing else."""
        self._owners = {b.name: b for b in known.owners}
        self._held = dict(known.held)

    def owner(self, name: str) -> str:
        """Return the part or tool that `name` is, or belongs to.

        Raises
        ------
        ValueError
            If nothing of that name is known.
        """
        if name in self._owners:
            return name
        if name in self._features:
            return self._features[name].owner
        tool = name.removesuffix(".grip")
        if tool in self._owners:
            return tool
        raise ValueError(f"nothing is known of {name!r}")

    def anchor(self, name: str) -> tuple[str, Point]:
        """Return the owner of `name` and its position in the owner's frame, um."""
        return self.owner(name), self._offset(name)

    def world(self, name: str, readings: Readings) -> Pose:
        """Return the believed world pose of `name`; its angle is its owner's."""
        belief = self._owners[self.owner(name)]
        pose = readings.carrier(belief.carrier).compose(belief.pose)
        x_um, y_um = pose.apply(*self._offset(name))
        return Pose(x_um=x_um, y_um=y_um, theta_rad=pose.theta_rad)

    def belief(self, name: str) -> Belief:
        """Return the belief of the part or tool that `name` is or belongs to."""
        return self._owners[self.owner(name)]

    def knows_angle(self, name: str) -> bool:
        """Return whether anything is known of the owner's angle."""
        return self._sigma_rad(name) < ANY_ANGLE_RAD

    def angle(self, name: str, readings: Readings) -> Believed | None:
        """Return the owner's angle in the world, None if nothing is known of it."""
        if not self.knows_angle(name):
            return None
        theta_rad = self.world(name, readings).theta_rad
        return Believed(theta_rad=theta_rad, sigma_rad=self._sigma_rad(name))

    def update(
        self,
        name: str,
        readings: Readings,
        x_um: float,
        y_um: float,
        theta_rad: float | None,
        sigma_theta_rad: float | None = None,
    ) -> None:
        """Re-anchor the owner so that `name` is where it was measured.

        An angle without a sigma counts as known.
        """
        owner = self.owner(name)
        belief = self._owners[owner]
        angle = (
            self.world(owner, readings).theta_rad if theta_rad is None else theta_rad
        )
        turn = Pose(x_um=0.0, y_um=0.0, theta_rad=angle)
        dx_um, dy_um = turn.apply(*self._offset(name))
        pose = Pose(x_um=x_um - dx_um, y_um=y_um - dy_um, theta_rad=angle)
        self._anchor(owner, belief.carrier, pose, readings)
        if theta_rad is not None:
            self._owners[owner] = replace(
                self._owners[owner], sigma_theta_rad=sigma_theta_rad or 0.0
            )

    def squeezed(
        self, part: str, tool: str, readings: Readings, rests: Sequence[RestAngle]
    ) -> Squeezed | None:
        """Return where closing jaws turn a part, None if that is not known.

        They turn none that has no rest angles; from an unknown angle nothing follows.
        """
        if not (rests and self.knows_angle(part) and self.knows_angle(tool)):
            return None
        inside = self._inside(part, tool, readings)
        sigma_rad = math.hypot(self._sigma_rad(part), self._sigma_rad(tool))
        return squeezed(rests, inside.theta_rad, sigma_rad)

    def grasp(
        self,
        part: str,
        tool: str,
        readings: Readings,
        across_um: float = 0.0,
        rests: Sequence[RestAngle] = (),
    ) -> None:
        """Hand a part to the tool: centred across the jaws, at its rest angle, y kept.

        `across_um` is where its origin is, from the jaws' middle, if no rest angle is
        known; its angle is kept then.
        """
        owner, holder = self.owner(part), self.owner(tool)
        found = self.squeezed(part, tool, readings, rests)
        pose = replace(self._inside(part, tool, readings), x_um=across_um)
        if found is not None:
            pose = replace(pose, x_um=found.across_um, theta_rad=found.theta_rad)
            self._widen(owner, math.hypot(found.sigma_rad, self._sigma_rad(holder)))
        world = self.world(holder, readings).compose(pose)
        self._anchor(owner, "robot", world, readings)
        self._held[owner] = holder

    def release(self, part: str, readings: Readings) -> None:
        """Put a part down where it is thought to be."""
        owner = self.owner(part)
        self._anchor(owner, "stage", self.world(owner, readings), readings)
        self._held.pop(owner, None)

    def held_by(self, tool: str) -> tuple[str, ...]:
        """Return the parts that `tool` is thought to hold."""
        holder = self.owner(tool)
        return tuple(sorted(p for p, t in self._held.items() if t == holder))

    def _inside(self, part: str, tool: str, readings: Readings) -> Pose:
        """Return the pose of a part's owner in the frame of a tool."""
        grip = self.world(self.owner(tool), readings)
        return grip.inverse().compose(self.world(self.owner(part), readings))

    def _sigma_rad(self, name: str) -> float:
        """Return the standard deviation of the owner's angle; pi: any."""
        return self._owners[self.owner(name)].sigma_theta_rad

    def _widen(self, owner: str, sigma_rad: float) -> None:
        """Raise the standard deviation of an angle to at least `sigma_rad`.

        It never falls: looks are tried about an angle that is not known so well, and
        how flat a part is fabricated is not stated.
        """
        belief = self._owners[owner]
        wider = replace(belief, sigma_theta_rad=max(belief.sigma_theta_rad, sigma_rad))
        self._owners[owner] = wider

    def _offset(self, name: str) -> Point:
        """Return a name's position in its owner's frame, um."""
        feature = self._features.get(name)
        return (0.0, 0.0) if feature is None else (feature.x_um, feature.y_um)

    def _anchor(
        self, owner: str, carrier: AxesName, world: Pose, readings: Readings
    ) -> None:
        """Note the world pose `world` of `owner` in the frame of `carrier`."""
        pose = readings.carrier(carrier).inverse().compose(world)
        pose = replace(pose, theta_rad=math.remainder(pose.theta_rad, 2 * math.pi))
        belief = self._owners[owner]
        if carrier != belief.carrier:  # it changes hands where it is
            lower_um = readings.reading(carrier).z_um
            under_um = readings.reading(belief.carrier).z_um + belief.z_um
            belief = replace(belief, z_um=under_um - lower_um)
        self._owners[owner] = replace(belief, carrier=carrier, pose=pose)
