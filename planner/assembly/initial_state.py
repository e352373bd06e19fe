"""The state of the world before the first step, from what the task starts with."""

from __future__ import annotations

import math

from microplan.planner.assembly.assembly import Axis4, PartState, State
from microplan.planner.task.task import Task
from microplan.schemas.pose import Pose


def initial(task: Task) -> State:
    """Return the state before step 1."""
    stage = task.workcell.stage
    parts = {
        name: PartState(
            carrier="stage",
            pose=Pose(x_um=s.x_um, y_um=s.y_um, theta_rad=s.theta_rad),
            z_um=0.0,
            sigma_xy_um=s.sigma_xy_um,
            sigma_z_um=0.0,
            sigma_theta_rad=math.pi if s.theta_any else s.sigma_theta_rad,
        )
        for name, s in task.part_starts.items()
    }
    tool = next(iter(task.tool_starts.values()), None)
    return State(
        stage=Axis4().moved(task.stage_start),
        robot=Axis4()
        if tool is None
        else Axis4(
            x_um=tool.x_um, y_um=tool.y_um, z_um=tool.z_um, theta_rad=tool.theta_rad
        ),
        opening_um=0.0 if tool is None else tool.opening_um,
        tool=None if tool is None else tool.name,
        held=None,
        parts=parts,
        stage_sigma_um=stage.axes.repeatability_xy_um,
        tip_sigma_um=turned_tip_um(task),
        pinned={},
        located=frozenset(),
    )


def turned_tip_um(task: Task) -> float:
    """Return the sigma of the grip's position after the robot's theta was set, um.

    The error of the angle swings the grip about an axis far behind it, which counts
    until a look has seen where it is.
    """
    robot = task.workcell.robot
    swing_um = robot.theta_axis_to_tip_um * robot.axes.repeatability_theta_rad
    return math.hypot(robot.axes.repeatability_xy_um, swing_um)
