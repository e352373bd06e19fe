"""Standard deviations that a look's trials are drawn with: tried, and as stated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from microplan.featuresel.look.scenario import TrialSpread, UnknownRotation
from microplan.optics.lens.lens import LensErrors
from microplan.optics.render.scene import Layer
from microplan.planner.assembly.assembly import (
    Place,
    height_sigma_um,
    locate_place,
)
from microplan.planner.assembly.swept_volume import SIGMAS
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import search_um
from microplan.planner.views.views import ViewPlan


def tried_spread(
    task: Task, request: Request, spot: Place, static: Sequence[Layer]
) -> TrialSpread:
    """Return what is tried: the task's benchmark, at least as the workcell states it.

    Of the lens only what changes how the target looks: what moves the whole image is a
    term of the error budget.
    """
    b, optics = task.benchmark, task.workcell.optics
    higher = _higher(task, request, spot, static)
    rotations = tuple(
        UnknownRotation(
            owner=part.owner,
            x_um=part.pose.x_um,
            y_um=part.pose.y_um,
            sigma_theta_rad=min(part.sigma_theta_rad, math.pi),
        )
        for part in higher
        # a tool's angle is in the uncertainty of its tips
        if part.owner in task.parts and part.sigma_theta_rad > 0
    )
    return TrialSpread(
        focus_sigma_um=max(b.focus_sigma_um, optics.focus.repeatability_um),
        magnification_sigma=max(b.magnification_sigma, optics.zoom.scale_sigma),
        light_gain=b.light_gain,
        light_gradient=b.light_gradient,
        pose_sigma_xy_um=math.hypot(spot.sigma_xy_um, b.pose_sigma_xy_um),
        pose_sigma_theta_rad=min(sigma_theta_rad(task, spot), math.pi),
        search_um=search_um(task, spot),
        occluder_sigma_um=max((place.sigma_xy_um for place in higher), default=0.0),
        turning=rotations,
        lens=LensErrors(
            field_curvature_sigma_per_um=optics.lens.field_curvature_sigma_per_um
        ),
    )


def together_um(view: ViewPlan, spot: Place) -> float:
    """Return by how much all that follows together may lie off in the region.

    Half a pixel, as the region moves by whole ones, or by what the frame leaves no room
    to move for.
    """
    if spot.followed_um == 0:
        return 0.0
    scope, region = view.microscope, view.region
    room_px = min(
        region.row,
        region.column,
        scope.height_px - region.row - region.rows,
        scope.width_px - region.column - region.columns,
    )
    left_um = SIGMAS * spot.followed_um - scope.um_per_px * room_px
    return max(scope.um_per_px / 2, left_um)


def stated_spread(
    task: Task, request: Request, spot: Place, tried: TrialSpread
) -> TrialSpread:
    """Return what the workcell states, and what the plan itself does not know.

    Focus: the drive's repeatability, and the height of the target.
    """
    cell = task.workcell
    height_um = height_sigma_um(task, request.state, spot.owner)
    off_um = math.hypot(cell.optics.focus.repeatability_um, height_um)
    return replace(
        tried,
        focus_sigma_um=off_um,
        magnification_sigma=cell.optics.zoom.scale_sigma,
        light_gain=(1.0, 1.0),
        light_gradient=(cell.light.gradient, cell.light.gradient),
        pose_sigma_xy_um=spot.sigma_xy_um,
        pose_sigma_theta_rad=min(spot.sigma_theta_rad, math.pi),
    )


def _higher(
    task: Task, request: Request, spot: Place, static: Sequence[Layer]
) -> list[Place]:
    """Return the poses of all that has layers higher than the target, by name.

    A lower body hides nothing.
    """
    names = sorted({la.name.partition(".")[0] for la in static if la.z_um > spot.z_um})
    return [locate_place(task, request.state, name) for name in names]


def sigma_theta_rad(task: Task, spot: Place) -> float:
    """Return sigma of the target's angle in the trials, rad."""
    return math.hypot(spot.sigma_theta_rad, task.benchmark.pose_sigma_theta_rad)
