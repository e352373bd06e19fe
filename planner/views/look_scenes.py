"""What stands where at a look, for those who draw it or look from there again."""

from __future__ import annotations

from microplan.planner.assembly.assembly import (
    Axis4,
    Carrier,
    Place,
    State,
    bodies,
    part_pose,
    robot_pose,
)
from microplan.planner.task.task import Task
from microplan.planner.views.scenes import target_ring
from microplan.planner.views.targets import TargetShape, outline_of
from microplan.schemas.files.scenes import LookScene, PlacedBody, SeenTarget
from microplan.schemas.plan import AxisMove
from microplan.schemas.pose import Pose


def look_scene(
    task: Task, state: State, look: str, shape: TargetShape, spot: Place
) -> LookScene:
    """Return the assembly at a look, and which edges the look is at."""
    return LookScene(
        look=look,
        target=_target(task, shape, spot),
        stage=_readings("stage", state.stage),
        robot=None if state.tool is None else _readings("robot", state.robot),
        opening_um=None if state.tool is None else state.opening_um,
        bodies=tuple(
            PlacedBody(
                name=body.name,
                pose=_pose(task, state, body.owner, body.name),
                z_um=body.z_high_um,
            )
            for body in bodies(task, state)
        ),
    )


def _target(task: Task, shape: TargetShape, spot: Place) -> SeenTarget:
    """Return whose edges a look is at; of a circle, those of the one ring."""
    if shape.owner in task.workcell.tools:
        names, ring = tuple(f"{shape.owner}.{side}" for side in ("left", "right")), None
    else:
        inner = shape.name.partition(".")[2].partition(".")[0]
        posts = task.parts[shape.owner].posts
        names = (f"{shape.owner}.{inner}" if inner in posts else shape.owner,)
        ring = target_ring(outline_of(task, shape), shape)
    return SeenTarget(name=shape.name, pose=spot.pose, bodies=names, ring=ring)


def _pose(task: Task, state: State, owner: str, name: str) -> Pose:
    """Return the pose of a body; jaws have moved by half the opening from closed."""
    if owner != state.tool:
        return part_pose(task, state, owner)
    half = state.opening_um / 2
    shift_um = -half if name.endswith(".left") else half
    return robot_pose(state.robot).compose(Pose(x_um=shift_um, y_um=0.0))


def _readings(name: Carrier, axes: Axis4) -> AxisMove:
    """Return where one axis group stands."""
    return AxisMove(
        axes=name,
        x_um=axes.x_um,
        y_um=axes.y_um,
        z_um=axes.z_um,
        theta_rad=axes.theta_rad,
    )
