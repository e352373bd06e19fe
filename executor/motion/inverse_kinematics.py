"""Inverse kinematics: axis readings that bring a carried point to a position."""

from __future__ import annotations

from microplan.executor.motion.beliefs import Readings
from microplan.schemas.plan import AxesName, AxisMove
from microplan.schemas.pose import Pose


def inverse_kinematics(
    axes: AxesName,
    readings: Readings,
    here: Pose,
    wanted_um: tuple[float, float],
    turn_rad: float = 0.0,
) -> AxisMove:
    """Return the absolute readings that bring a carried point to `wanted_um`."""
    now = readings.reading(axes)
    pivot = readings.theta_axis_um if axes == "stage" else (0.0, 0.0)
    center = (now.x_um + pivot[0], now.y_um + pivot[1])  # the axis travels along
    turn = Pose(x_um=0.0, y_um=0.0, theta_rad=turn_rad)
    swung = turn.apply(here.x_um - center[0], here.y_um - center[1])
    return AxisMove(
        axes=axes,
        x_um=wanted_um[0] - swung[0] - pivot[0],
        y_um=wanted_um[1] - swung[1] - pivot[1],
        theta_rad=now.theta_rad + turn_rad if turn_rad else None,
    )
