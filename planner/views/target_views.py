"""Microscope settings that show a look's target."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.arrays import Box
from microplan.optics.outline.tolerant_order import least
from microplan.optics.render.scene import Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import Place, locate_place
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.surfaces import surfaces
from microplan.planner.task.task import PartFeature, Task
from microplan.planner.views.focus import focus_for
from microplan.planner.views.light.layer_reach import relevant
from microplan.planner.views.light.lit_layers import field_level
from microplan.planner.views.light.opaque_below import report_opaque
from microplan.planner.views.requests import Request
from microplan.planner.views.scenes import (
    edge_points,
    shade_of,
    world_scene,
)
from microplan.planner.views.targets import (
    TargetShape,
    outline_of,
    shape_of,
    surface_of,
)
from microplan.planner.views.views import (
    SEARCH_SIGMAS,
    ViewPlan,
    light_level,
    region_for,
)
from microplan.planner.views.zooms import (
    LADDER,
    Origin,
    ZoomRange,
    magnifications,
    microscope_at,
    zoom_range,
)
from microplan.schemas.pose import Pose

# Part of a target's edges that may be covered before a look is called into question.
HIDDEN_SHARE = 0.5


def views(
    task: Task, request: Request, current: float, report: Report
) -> tuple[ViewPlan, ...]:
    """Return the settings that show the target, the preferred one first.

    Reports why there is none, and what limits those there are.
    """
    cell = task.workcell
    shape = shape_of(task, request.state, request.target)
    fault, hint = _fault(task, request, shape)
    if shape is None or fault:
        report.refuse("MP502", request.where, fault, hint)
        return ()
    target_at = target_pose(task, request, shape)
    focus = focus_for(cell, target_at, report, request.where)
    origin = _origin(task, request, target_at)
    zooms = magnifications(cell, shape, target_at, current, report, origin)
    if focus is None:
        return ()
    scene = world_scene(task, request.state)
    found = [
        _lit(task, scene, target_at, microscope_at(cell, zoom), focus, shape.box_um)
        for zoom in zooms
    ]
    if found:
        _report_tight(task, request, shape, target_at, report)
        widest = least((v.microscope for v in found), lambda scope: -scope.aperture)
        _report_shade(task, request, shape, target_at, widest, report)
        if task.workcell.light.is_transmitted and shape.owner in task.parts:
            points = edge_points(task, shape, target_at)
            args = task, request.state, shape, target_at.z_um, points
            if report_opaque(*args, request.where, report):
                return ()
    return tuple(found)


def _fault(task: Task, request: Request, shape: TargetShape | None) -> tuple[str, str]:
    """Return why no routine can measure a target, and what helps; "" if one can."""
    if shape is None:
        hint = "target its part, or a feature of kind circle, teeth or outline"
        return f"no routine finds {request.target}", hint
    if _is_avoided(task, request.target):
        hint = "target its part or another feature, or leave 'avoid' out"
        return f"{request.target} is marked 'avoid': it is never looked for", hint
    if request.needs_angle_rad is not None and not _tells_angle(task, shape):
        hint = "target something with an angle, or ask for none"
        return f"no routine measures the angle of {request.target}", hint
    return "", ""


def zooms_of(task: Task, request: Request) -> ZoomRange:
    """Return the magnifications that a look with views allows."""
    shape = needed_shape(task, request)
    return zoom_range(task.workcell, shape, target_pose(task, request, shape))


def _report_tight(
    task: Task, request: Request, shape: TargetShape, target_at: Place, report: Report
) -> None:
    """Report a look that a slightly larger sigma or finer detail would forbid."""
    found = zoom_range(task.workcell, shape, target_at)
    if found.most >= LADDER * found.least:
        return
    ends = (("least", found.least), ("most", found.most))
    why = [
        next(b for b in found.bounds if b.end == end and b.magnification == value)
        for end, value in ends
    ]
    report.fact(
        "MP406",
        request.where,
        f"look {request.id!r}: {shape.name} can be looked at between {found.least:.4g} "
        f"and {found.most:.4g} x only: less is barred by {why[0].by} "
        f"({why[0].reason}), more by {why[1].by} ({why[1].reason})",
        "for more room, or where a small change gives MP401, look at it nearer the "
        "middle of the field ('view_um'), or state a smaller sigma at its start if "
        "that is true",
    )


def _tells_angle(task: Task, shape: TargetShape) -> bool:
    """Return whether the target, or other features of its part, have an angle.

    A round post is alone at its height.
    """
    part = task.parts.get(shape.owner)
    alone = part is None or shape.body.partition(".")[2] in part.posts
    return shape.has_angle or not alone


def _is_avoided(task: Task, target: str) -> bool:
    """Return whether a look's target is a feature that the task forbids."""
    owner, _, inner = target.partition(".")
    part = task.parts.get(owner)
    return part is not None and inner in part.features and part.features[inner].avoid


def _origin(task: Task, request: Request, target_at: Place) -> Origin:
    """Return where the file says what the look is about and what puts it there."""
    start = task.where.get(f"start.{target_at.owner}.sigma_xy_um")
    return Origin(
        look=request.id,
        target=request.where,
        view=request.view_where,
        sigma=start if target_at.carrier == "stage" else None,
    )


def _report_shade(
    task: Task,
    request: Request,
    shape: TargetShape,
    target_at: Place,
    scope: Microscope,
    report: Report,
) -> None:
    """Report occluders of a target's edges, or of their light cones."""
    shades = shade_of(
        task, request.state, shape, target_at, scope.aperture, scope.medium_index
    )
    if not shades:
        return
    covering = [f"{s.by} {s.hidden:.0%}" for s in shades if s.hidden]
    hidden = sum(shade.hidden for shade in shades)
    if hidden > HIDDEN_SHARE:
        report.warning(
            "MP306",
            request.where,
            f"look {request.id!r}: most edges of {shape.name} are hidden: "
            f"{', '.join(covering)}",
            "look where nothing stands over it: another view_um, or the tool away",
        )
        return
    names = ", ".join(shade.by for shade in shades)
    said = ", ".join(covering)
    reached = max(shade.hidden + shade.shaded for shade in shades)
    report.fact(
        "MP306",
        request.where,
        f"look {request.id!r}: what stands higher than {shape.name} ({names}) hides "
        f"{f'some of its edges ({said})' if said else 'none of its edges'}, and takes "
        f"light on one side from up to {reached:.0%} of them",
        "trials of the look have it; if they find nothing good enough, choose a "
        "'view_um' where nothing higher stands near",
    )


def whole_view(task: Task, request: Request, view: ViewPlan) -> ViewPlan:
    """Return the view with a region that holds all of the target's body, as far as the
    frame does: other features of it may replace the target."""
    shape = needed_shape(task, request)
    if shape.owner in task.workcell.tools:
        return view
    x0, y0, x1, y1 = outline_of(task, shape).bounds_um
    reach = math.hypot(max(-x0, x1), max(-y0, y1))
    target_at = target_pose(task, request, shape)
    box = (-reach, -reach, reach, reach)
    scene = world_scene(task, request.state)
    return _lit(task, scene, target_at, view.microscope, view.focus_um, box)


def marks_view(task: Task, request: Request, view: ViewPlan) -> ViewPlan:
    """Return the view with a region that holds the target and the features that the
    task declares at its height, as far as the frame does."""
    shape = needed_shape(task, request)
    part = task.parts.get(shape.owner)
    if part is None:
        return view
    heights, z_um = surfaces(part), surface_of(part, shape).z_um
    target_at = target_pose(task, request, shape)
    boxes = [shape.box_um] + [
        _box_about(feature, target_at.pose.theta_rad, shape.center_um)
        for feature in part.features.values()
        if heights[feature.on].z_um == z_um
        and not feature.avoid
        and (feature.kind != "outline" or feature.region)
    ]
    box = (
        min(b[0] for b in boxes), min(b[1] for b in boxes),
        max(b[2] for b in boxes), max(b[3] for b in boxes),
    )  # fmt: skip
    scene = world_scene(task, request.state)
    return _lit(task, scene, target_at, view.microscope, view.focus_um, box)


def _box_about(
    feature: PartFeature, theta_rad: float, about_um: tuple[float, float]
) -> Box:
    """Return a feature's box about a point of its part, in the world's axes."""
    x, y = (c - a for c, a in zip(feature.center_um, about_um, strict=True))
    turn = Pose(x_um=0.0, y_um=0.0, theta_rad=theta_rad)
    x_um, y_um = turn.apply(x, y)
    r = feature.radius_um
    return (x_um - r, y_um - r, x_um + r, y_um + r)


def _lit(
    task: Task, scene: Scene, target_at: Place, scope: Microscope, focus_um: float,
    box_um: Box,
) -> ViewPlan:  # fmt: skip
    """Return a view of a box about a target, lit for the brightest of what it shows."""
    region = region_for(scope, box_um, target_at, search_um(task, target_at))
    seen = relevant(scene.layers, scope, focus_um, region)
    cell = task.workcell
    field = field_level(scene.background, cell, scope)
    level = light_level(cell, seen, task.benchmark, field)
    return ViewPlan(microscope=scope, focus_um=focus_um, light=level, region=region)


def target_pose(task: Task, request: Request, shape: TargetShape) -> Place:
    """Return the nominal pose of the target's reference point.

    Its sigma takes in how far it swings about the owner's own origin, or about what a
    look before has measured.
    """
    place, about_um = locate_place(task, request.state, shape.owner), (0.0, 0.0)
    if request.known is not None:
        about_um = request.known.about_um
        theta_rad = request.known.sigma_theta_rad
        place = replace(
            place,
            sigma_xy_um=request.known.sigma_um,
            followed_um=0.0,
            sigma_theta_rad=place.sigma_theta_rad if theta_rad is None else theta_rad,
        )
    x_um, y_um = place.pose.apply(*shape.center_um)
    face = locate_place(task, request.state, request.target).z_um
    swing_um = min(place.sigma_theta_rad, 1.0) * math.dist(shape.center_um, about_um)
    return replace(
        place,
        name=shape.name,
        pose=Pose(x_um=x_um, y_um=y_um, theta_rad=place.pose.theta_rad),
        z_um=face,
        sigma_xy_um=math.hypot(place.sigma_xy_um, swing_um),
    )


def search_um(task: Task, target_at: Place) -> float:
    """Return how far from nominal the target may be when a look begins."""
    sigma = math.hypot(target_at.sigma_xy_um, task.benchmark.pose_sigma_xy_um)
    return SEARCH_SIGMAS * sigma


def needed_shape(task: Task, request: Request) -> TargetShape:
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
