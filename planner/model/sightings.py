"""Where a look's target is, and the settings of the microscope that show it."""

from __future__ import annotations

import math

from planner.diagnostics import Report
from planner.inputs.task import Task
from planner.model.assembly import Place, locate_place
from planner.model.requests import Request
from planner.model.scenes import relevant, world_scene
from planner.model.targets import Shape, shape_of
from planner.model.views import (
    SEARCH_SIGMAS,
    ViewPlan,
    focus_for,
    light_level,
    magnifications,
    microscope_at,
    region_for,
)
from schemas.pose import Pose


def views(
    task: Task, request: Request, current: float, report: Report
) -> tuple[ViewPlan, ...]:
    """Return the settings that show the target, the preferred one first."""
    cell = task.workcell
    shape = shape_of(task, request.state, request.target)
    if shape is None:
        report.refuse(
            "MP502",
            request.where,
            f"no routine finds {request.target}",
            "target its part, or a feature of kind circle, teeth or outline",
        )
        return ()
    if request.needs_angle_rad is not None and not shape.has_angle:
        report.refuse(
            "MP502",
            request.where,
            f"no routine measures the angle of {request.target}",
            "leave tolerance_theta_deg out, or target something with an angle",
        )
        return ()
    spot = spot_of(task, request, shape)
    focus = focus_for(cell, spot, report, request.where)
    zooms = magnifications(cell, shape, spot, current, report, request.where)
    if focus is None:
        return ()
    scene = world_scene(task, request.state)
    found = []
    for zoom in zooms:
        scope = microscope_at(cell, zoom)
        region = region_for(scope, shape.box_um, spot, search_um(task, spot))
        seen = relevant(scene.layers, scope, focus, region)
        level = light_level(cell, seen, task.benchmark)
        found.append(
            ViewPlan(microscope=scope, focus_um=focus, light=level, region=region)
        )
    return tuple(found)


def spot_of(task: Task, request: Request, shape: Shape) -> Place:
    """Return where the target's reference point nominally is."""
    place = locate_place(task, request.state, shape.owner)
    x_um, y_um = place.pose.apply(*shape.center_um)
    face = locate_place(task, request.state, request.target).z_um
    return Place(
        name=shape.name,
        owner=place.owner,
        carrier=place.carrier,
        pose=Pose(x_um=x_um, y_um=y_um, theta_rad=place.pose.theta_rad),
        z_um=face,
        sigma_xy_um=place.sigma_xy_um,
        sigma_theta_rad=place.sigma_theta_rad,
    )


def search_um(task: Task, spot: Place) -> float:
    """Return how far from nominal the target may be when a look begins."""
    sigma = math.hypot(spot.sigma_xy_um, task.benchmark.pose_sigma_xy_um)
    return SEARCH_SIGMAS * sigma


def needed_shape(task: Task, request: Request) -> Shape:
    """Return the shape of a target that `views` has accepted.

    Raises
    ------
    ValueError
        If the target has none.
    """
    shape = shape_of(task, request.state, request.target)
    if shape is None:
        raise ValueError(f"{request.target} has no shape a routine could look for")
    return shape
