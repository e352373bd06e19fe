"""Where a held part touches a finger."""

from __future__ import annotations

import numpy as np
import shapely

from microplan.planner.assembly.assembly import State
from microplan.planner.assembly.shapes import hull
from microplan.planner.task.task import Task

# A corner of a hull within this of a jaw touches it: edges as made vary by more.
TOUCH_UM = 0.05
# What touches by one corner is taken as this wide: corners as made are round.
LEAST_WIDTH_UM = 0.1


def contact_um2(task: Task, state: State, name: str) -> float:
    """Return the area over which a held part faces one finger, the larger of both.

    The length of its hull that lies flat against a jaw, times the height that part and
    finger share.
    """
    part, held = task.parts[name], state.parts[name]
    tool = task.workcell.tools[state.tool or ""]
    turned = shapely.affinity.rotate(
        hull(part.outline), held.pose.theta_rad, origin=(0, 0), use_radians=True
    )
    points = shapely.get_coordinates(turned)
    width = max(_flat_um(points * side) for side in (1.0, -1.0))
    low = max(held.z_um, 0.0)
    high = min(held.z_um + part.thickness_um, tool.thickness_um)
    return max(width, LEAST_WIDTH_UM) * max(high - low, LEAST_WIDTH_UM)


def _flat_um(points: np.ndarray) -> float:
    """Return how much of y lies within TOUCH_UM of the greatest x."""
    touching = points[points[:, 0] > points[:, 0].max() - TOUCH_UM, 1]
    return float(np.ptp(touching))
