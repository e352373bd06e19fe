"""The assembly state: poses, carriers, grip, with the bodies they put in the world.

Nominal poses with their standard deviation per axis. The stage's frame is
the world at stage reading 0; the tool's frame is its grip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from microplan.optics.outline.outline import Outline, place
from microplan.planner.task.finishes import SurfaceFinish
from microplan.planner.task.surfaces import OWN, Covering, marks_on, surfaces
from microplan.planner.task.task import Part, Post, Reading, Task
from microplan.planner.task.workcell import AxesSpec, Tool
from microplan.schemas.pose import Pose

Carrier = Literal["stage", "robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis4:
    """Readings of one axis group."""

    x_um: float = 0.0
    y_um: float = 0.0
    z_um: float = 0.0
    theta_rad: float = 0.0

    def moved(self, to: Reading) -> Axis4:
        """Return the readings after a move; None leaves an axis."""
        return Axis4(
            x_um=self.x_um if to.x_um is None else to.x_um,
            y_um=self.y_um if to.y_um is None else to.y_um,
            z_um=self.z_um if to.z_um is None else to.z_um,
            theta_rad=self.theta_rad if to.theta_rad is None else to.theta_rad,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PartState:
    """Where a part is, in the frame of what carries it."""

    carrier: Carrier
    pose: Pose
    z_um: float  # underside above the stage's surface, or relative to the tool's
    sigma_xy_um: float
    sigma_z_um: float
    sigma_theta_rad: float  # pi: any angle


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The world between two actions."""

    stage: Axis4
    robot: Axis4
    opening_um: float
    tool: str | None
    held: str | None
    parts: Mapping[str, PartState]
    stage_sigma_um: float  # standard deviation of the stage's position, per axis
    tip_sigma_um: float  # standard deviation of the grip's position, per axis
    pinned: Mapping[str, float]  # part -> sigma in the world, while a servo holds it
    located: frozenset[str]  # names measured since they last changed hands
    # sigma of how far a goal, and the robot that was brought to it, are from their
    # planned places; both are off together, which a run has seen
    followed_um: float = 0.0
    strayed_um: float = 0.0  # the same of the grip alone, since it has left that goal
    stage_moved_um: float = 0.0  # sigma of what the stage errs by since it moved away

    def axes(self, carrier: Carrier) -> Axis4:
        """Return the readings of one axis group."""
        return self.stage if carrier == "stage" else self.robot

    def carried(self, carrier: Carrier, to: Axis4) -> State:
        """Return the state with one axis group at other readings, nothing else new."""
        if carrier == "stage":
            return replace(self, stage=to)
        return replace(self, robot=to)


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A prism in the world: outline x [z_low_um, z_high_um]."""

    name: str
    owner: str  # part or tool
    carrier: Carrier
    outline: Outline
    z_low_um: float
    z_high_um: float
    reflectance: float
    surface: SurfaceFinish
    sigma_xy_um: float
    sigma_z_um: float
    marks: tuple[Covering, ...] = ()  # that lie flat on top of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A named thing in the world: its reference point and the height of its face."""

    name: str
    owner: str
    carrier: Carrier
    pose: Pose
    z_um: float
    sigma_xy_um: float
    sigma_theta_rad: float
    followed_um: float = 0.0  # as `State.followed_um`, besides

    @property
    def frame_sigma_um(self) -> float:
        """Return the sigma of where it is seen in the frame, per axis, um."""
        return math.hypot(self.sigma_xy_um, self.followed_um)


def stage_pose(task: Task, stage: Axis4) -> Pose:
    """Return the pose of the stage's frame: a rotation about its axis, then a shift."""
    axis_x, axis_y = task.workcell.stage.theta_axis_um
    turn = Pose(x_um=0.0, y_um=0.0, theta_rad=stage.theta_rad)
    back_x, back_y = turn.apply(-axis_x, -axis_y)
    return Pose(
        x_um=stage.x_um + axis_x + back_x,
        y_um=stage.y_um + axis_y + back_y,
        theta_rad=stage.theta_rad,
    )


def robot_pose(robot: Axis4) -> Pose:
    """Return the pose of the tool's grip."""
    return Pose(x_um=robot.x_um, y_um=robot.y_um, theta_rad=robot.theta_rad)


def carrier_pose(task: Task, state: State, carrier: Carrier) -> Pose:
    """Return the world pose of what carries a part."""
    if carrier == "stage":
        return stage_pose(task, state.stage)
    return robot_pose(state.robot)


def part_pose(task: Task, state: State, name: str) -> Pose:
    """Return the nominal world pose of a part."""
    part = state.parts[name]
    return carrier_pose(task, state, part.carrier).compose(part.pose)


def part_z_um(task: Task, state: State, name: str) -> float:
    """Return the world height of a part's underside."""
    part = state.parts[name]
    if part.carrier == "stage":
        return task.workcell.stage.datum_z_um + state.stage.z_um + part.z_um
    return state.robot.z_um + part.z_um


def part_sigma_um(state: State, name: str) -> float:
    """Return the sigma of a part's position in the world, per axis, um."""
    part = state.parts[name]
    if name in state.pinned:
        return math.hypot(state.pinned[name], state.stage_moved_um)
    if part.carrier == "stage":
        sigma_um = math.hypot(part.sigma_xy_um, state.stage_sigma_um)
        return math.hypot(sigma_um, state.stage_moved_um)
    return math.hypot(part.sigma_xy_um, grip_sigma_um(state))


def grip_sigma_um(state: State) -> float:
    """Return the sigma of the grip beside what it may have followed, per axis, um."""
    return math.hypot(state.tip_sigma_um, state.strayed_um)


def planned_sigma_um(task: Task, state: State, name: str) -> float:
    """Return the sigma of a part on the stage from where the plan has it, um.

    Whatever it is near.
    """
    if state.followed_um == 0:
        return part_sigma_um(state, name)
    rest_um = task.workcell.stage.axes.repeatability_xy_um
    return math.hypot(state.parts[name].sigma_xy_um, rest_um)


def height_sigma_um(task: Task, state: State, owner: str) -> float:
    """Return the sigma of a part's or tool's height, um."""
    return next(b.sigma_z_um for b in bodies(task, state) if b.owner == owner)


def axes_of(task: Task, carrier: Carrier) -> AxesSpec:
    """Return the axes that move what is on `carrier`."""
    if carrier == "stage":
        return task.workcell.stage.axes
    return task.workcell.robot.axes


def owner_of(name: str) -> str:
    """Return the part or tool that a dotted name belongs to."""
    return name.partition(".")[0]


def locate_place(task: Task, state: State, name: str) -> Place:
    """Return the nominal pose of a part, feature, post, tool or grip."""
    owner, _, inner = name.partition(".")
    if owner in task.workcell.tools:
        return _tool_place(task, state, name, task.workcell.tools[owner])
    part, held = task.parts[owner], state.parts[owner]
    pose = part_pose(task, state, owner)
    x_um, y_um = pose.apply(*inner_center(part, inner))
    return Place(
        name=name,
        owner=owner,
        carrier=held.carrier,
        pose=Pose(x_um=x_um, y_um=y_um, theta_rad=pose.theta_rad),
        z_um=part_z_um(task, state, owner) + face_um(part, inner),
        sigma_xy_um=part_sigma_um(state, owner),
        sigma_theta_rad=held.sigma_theta_rad,
        followed_um=state.followed_um,
    )


def inner_center(part: Part, inner: str) -> tuple[float, float]:
    """Return the centre of a feature or post in its part's frame; "" is the origin."""
    if inner in part.posts:
        return part.posts[inner].center_um
    if inner:
        return part.features[inner].center_um
    return (0.0, 0.0)


def face_um(part: Part, inner: str) -> float:
    """Return the height of a feature's or post's face above the part's underside."""
    named = part.features.get(inner)
    return surfaces(part)[named.on if named else inner].z_um


def bodies(task: Task, state: State) -> tuple[Body, ...]:
    """Return every prism in the world, by height of the top, then by name."""
    found = [b for name in sorted(state.parts) for b in _part_bodies(task, state, name)]
    if state.tool is not None:
        found += _tool_bodies(task, state, task.workcell.tools[state.tool])
    return tuple(sorted(found, key=lambda b: (b.z_high_um, b.name)))


def with_part(state: State, name: str, part: PartState) -> State:
    """Return `state` with one part replaced."""
    return replace(state, parts={**state.parts, name: part})


def _tool_place(task: Task, state: State, name: str, tool: Tool) -> Place:
    """Return the pose of a tool's grip; its face is the top of the fingers."""
    return Place(
        name=name,
        owner=tool.name,
        carrier="robot",
        pose=robot_pose(state.robot),
        z_um=state.robot.z_um + tool.thickness_um,
        sigma_xy_um=grip_sigma_um(state),
        sigma_theta_rad=task.workcell.robot.axes.repeatability_theta_rad,
        followed_um=state.followed_um,
    )


def _part_bodies(task: Task, state: State, name: str) -> list[Body]:
    """Return a part's prism and the prisms of its posts."""
    part, pose = task.parts[name], part_pose(task, state, name)
    low = part_z_um(task, state, name)
    held = state.parts[name]
    sigma_z = (
        task.workcell.stage.axes.repeatability_z_um
        if held.carrier == "stage"
        else held.sigma_z_um
    )
    prisms: list[tuple[str, Part | Post, float, float]] = [
        (OWN, part, low, part.thickness_um)
    ]
    foot = low + part.thickness_um
    prisms += [(post.name, post, foot, post.height_um) for post in part.posts.values()]
    return [
        Body(
            name=f"{name}.{face}" if face else name,
            owner=name,
            carrier=held.carrier,
            outline=place(one.outline, pose.x_um, pose.y_um, pose.theta_rad),
            z_low_um=base,
            z_high_um=base + height,
            reflectance=one.reflectance,
            surface=one.surface,
            sigma_xy_um=part_sigma_um(state, name),
            sigma_z_um=sigma_z,
            marks=marks_on(part, face, (pose.x_um, pose.y_um, pose.theta_rad)),
        )
        for face, one, base, height in prisms
    ]


def _tool_bodies(task: Task, state: State, tool: Tool) -> list[Body]:
    """Return the two fingers at the present opening."""
    pose, axes = robot_pose(state.robot), task.workcell.robot.axes
    return [
        Body(
            name=name,
            owner=tool.name,
            carrier="robot",
            outline=place(outline, pose.x_um, pose.y_um, pose.theta_rad),
            z_low_um=state.robot.z_um,
            z_high_um=state.robot.z_um + tool.thickness_um,
            reflectance=tool.reflectance,
            surface=tool.surface,
            sigma_xy_um=grip_sigma_um(state),
            sigma_z_um=axes.repeatability_z_um,
        )
        for name, outline in opened_fingers(tool, state.opening_um)
    ]


def opened_fingers(
    tool: Tool, opening_um: float
) -> tuple[tuple[str, Outline], tuple[str, Outline]]:
    """Return the fingers' names and outlines in the grip's frame, opened, um."""
    return (
        (f"{tool.name}.left", place(tool.left, -opening_um / 2, 0.0)),
        (f"{tool.name}.right", place(tool.right, opening_um / 2, 0.0)),
    )
