"""Coarse looks: lower zooms that locate a target before its fine look."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.optics.outline.tolerant_order import ordered
from microplan.planner.assembly.assembly import axes_of, bodies, owner_of
from microplan.planner.assembly.swept_volume import SIGMAS, sweep_hits
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import (
    ANGLE_RAD,
    PERIOD_SHARE,
    PriorKnowledge,
    Request,
)
from microplan.planner.views.target_views import (
    needed_shape,
    search_um,
    target_pose,
    views,
)
from microplan.planner.views.targets import TargetShape, shape_of
from microplan.planner.views.views import SEARCH_SIGMAS, ViewPlan
from microplan.schemas.plan.views import CoarseFirst

SUFFIX = "coarse"  # of a coarse look's id
MOST_COARSE = 2  # targets that are tried for a coarse look
# A target farther off than this many of its search ranges is no honest sighting: the
# gates of the coarse look allow no more.
FAR = 1.5
GAIN = 0.5  # of its sigma, at most, a position must have after a coarse look
MAY_HELP = ("MP401", "MP403", "MP501")  # codes that a better known position may cure


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarseLook:
    """Accuracy that a coarse look must have, or has reached."""

    sigma_um: float  # per axis, bias included
    sigma_theta_rad: float | None  # None: the angle is not measured
    magnification: float
    focus_um: float


def coarse_requests(task: Task, request: Request) -> tuple[Request, ...]:
    """Return coarse looks that may come before a look, the first to try first.

    The target itself, then what else of its part is coarsest; only what has a view.
    Empty where a step does more than look, or the target belongs to a tool.
    """
    owner = owner_of(request.target)
    if not request.divisible or owner not in task.parts:
        return ()
    features = [f for f in task.parts[owner].features.values() if not f.avoid]
    own = [owner, *(f"{owner}.{f.name}" for f in features)]
    names = dict.fromkeys((request.target, *own))
    if shape_of(task, request.state, request.target) is None:
        return ()
    shapes: dict[str, tuple[str, TargetShape]] = {}  # a part and its teeth are one
    for name in names:
        shape = shape_of(task, request.state, name)
        if shape is not None:
            shapes.setdefault(shape.name, (name, shape))
    known = ordered(list(shapes.values()), lambda each: -each[1].finest_um)
    known.sort(key=lambda each: each[0] != request.target)
    low, _ = task.workcell.optics.magnification
    found = [_coarse(task, request, name, shape) for name, shape in known]
    shown = [each for each in found if views(task, each, low, Report())]
    return tuple(shown[:MOST_COARSE])


def _coarse(task: Task, request: Request, name: str, shape: TargetShape) -> Request:
    """Return a look at a part's feature, as fine as a pixel.

    Its angle is measured, if it has one, where the fine look's target would else swing
    about it by more than its own finest detail.
    """
    target = needed_shape(task, request)
    target_at = target_pose(task, request, target)
    arm_um = math.dist(shape.center_um, target.center_um)
    swing_um = min(target_at.sigma_theta_rad, 1.0) * arm_um
    return replace(
        request,
        id=f"{request.id}.{SUFFIX}",
        target=name,
        tolerance_um=None,
        wants_angle=shape.has_angle and swing_um > target.finest_um,
        needs_angle_rad=None,
        divisible=False,
    )


def assumed(task: Task, coarse: Request) -> CoarseLook:
    """Return the accuracy assumed of a coarse look: half its tolerances."""
    shape = needed_shape(task, coarse)
    angle_rad = ANGLE_RAD
    if shape.symmetry > 1:
        angle_rad = PERIOD_SHARE * 2 * math.pi / shape.symmetry
    low, _ = task.workcell.optics.magnification
    view = min(
        views(task, coarse, low, Report()), key=lambda v: v.microscope.magnification
    )
    return CoarseLook(
        sigma_um=view.microscope.um_per_px / SIGMAS,
        sigma_theta_rad=angle_rad / SIGMAS if coarse.wants_angle else None,
        magnification=view.microscope.magnification,
        focus_um=view.focus_um,
    )


def fine_request(
    task: Task, request: Request, coarse: Request, seen: CoarseLook
) -> Request | None:
    """Return the look that follows a coarse one, None if it cannot.

    The target is brought to its nominal position by the axes that carry it, and back
    afterwards. What two moves leave is taken off the tolerance. None if nothing is left
    of it, if the position is hardly better known than before, or if on the path
    something may be touched or an axis end.
    """
    target_at = target_pose(task, request, needed_shape(task, request))
    moved_um = math.sqrt(2) * axes_of(task, target_at.carrier).repeatability_xy_um
    tolerance_um = request.tolerance_um
    if tolerance_um is not None:
        left = tolerance_um**2 - (SIGMAS * moved_um) ** 2
        if left <= 0:
            return None
        tolerance_um = math.sqrt(left)
    if not _is_clear(task, request):
        return None
    position_sigma_um = math.hypot(moved_um, _position_sigma_um(task, request, seen))
    if position_sigma_um > GAIN * target_at.frame_sigma_um:
        return None
    known = PriorKnowledge(
        about_um=needed_shape(task, coarse).center_um,
        sigma_um=position_sigma_um,
        sigma_theta_rad=seen.sigma_theta_rad,
    )
    return replace(request, tolerance_um=tolerance_um, known=known, divisible=False)


def may_gain(task: Task, request: Request, fine: Request) -> bool:
    """Return whether a look that trials refused may do better after a coarse one.

    Its position then allows more zoom, or an unknown zoom no longer errs by the
    tolerance (a pixel, where none is asked for) over how far off the target may lie.
    """
    low, _ = task.workcell.optics.magnification
    zooms = [
        max(v.microscope.magnification for v in views(task, r, low, Report()))
        for r in (request, fine)
    ]
    if zooms[1] > zooms[0]:
        return True
    target_at = target_pose(task, request, needed_shape(task, request))
    pixel_um = task.workcell.camera.pitch_um / zooms[0]
    error_um = SIGMAS * task.benchmark.magnification_sigma * search_um(task, target_at)
    return error_um > (request.tolerance_um or pixel_um)


def centring(task: Task, request: Request, coarse_id: str) -> CoarseFirst:
    """Return how the target of a look is centred after a coarse one."""
    target_at = target_pose(task, request, needed_shape(task, request))
    return CoarseFirst(
        look=coarse_id,
        axes=target_at.carrier,
        at_um=(target_at.pose.x_um, target_at.pose.y_um),
        most_um=_most_um(task, request),
    )


def _position_sigma_um(task: Task, request: Request, seen: CoarseLook) -> float:
    """Return the sigma of a position from a coarse look at another zoom, um.

    Adds to its own sigma the jump of the image with the zoom, its shift with the
    focus, and an unknown scale times the distance from the axis.
    """
    target_at = target_pose(task, request, needed_shape(task, request))
    optics = task.workcell.optics
    far_um = (
        math.hypot(target_at.pose.x_um, target_at.pose.y_um)
        + SIGMAS * target_at.frame_sigma_um
    )
    height_um = abs(target_at.z_um - seen.focus_um)
    return math.hypot(
        seen.sigma_um,
        optics.zoom.parcentric_sigma_um,
        optics.zoom.scale_sigma * far_um,
        optics.focus.lateral_sigma_um_per_um * height_um,
    )


def _most_um(task: Task, request: Request) -> float:
    """Return how far a target may have to be moved."""
    target_at = target_pose(task, request, needed_shape(task, request))
    far_um = SEARCH_SIGMAS * target_at.followed_um
    return FAR * math.hypot(search_um(task, target_at), far_um)


def _is_clear(task: Task, request: Request) -> bool:
    """Return whether the target may be moved as far as needed, in any direction."""
    target_at = target_pose(task, request, needed_shape(task, request))
    state, axes = request.state, axes_of(task, target_at.carrier)
    most = _most_um(task, request)
    at = state.axes(target_at.carrier)
    for name, value in (("x_um", at.x_um), ("y_um", at.y_um)):
        low, high = axes.limits.get(name, (-math.inf, math.inf))
        if not low <= value - most <= value + most <= high:
            return False
    sigma_um = max(
        b.sigma_xy_um for b in bodies(task, state) if b.carrier == target_at.carrier
    )
    room = most + SIGMAS * sigma_um
    box = (-room, -room, room, room)
    return not sweep_hits(task, state, state, carrier=target_at.carrier, deviation=box)


def first_views(
    task: Task, request: Request, current: float, report: Report
) -> tuple[Request, tuple[ViewPlan, ...]]:
    """Return what is looked at first for a request, and the settings that show it.

    The request itself, or a coarse look where only that has a view and the fine one has
    after it, if the coarse one is as good as it must be: the trials of a compile
    decide. Reports why either has no view.
    """
    plain = Report()
    found = views(task, request, current, plain)
    codes = {d.code for d in plain.found if d.severity == "infeasible"}
    if not found and codes & set(MAY_HELP):
        for coarse in coarse_requests(task, request):
            fine = fine_request(task, request, coarse, assumed(task, coarse))
            seen = Report()
            if fine is not None and views(task, fine, current, seen):
                report_coarse(request, coarse, plain, "to a pixel", report)
                report.found += seen.found
                return coarse, views(task, coarse, current, report)
    report.found += plain.found
    return request, found


def report_coarse(
    request: Request, coarse: Request, plain: Report, how: str, report: Report
) -> None:
    """Report that a look is made in two, and why one does not do."""
    why = next(d for d in plain.found if d.severity == "infeasible")
    said = why.message.removeprefix(f"look {request.id!r}: ")
    if why.code == "MP501":
        said = said.partition(": ")[0]  # what every routine lacks fills a page
    report.note(
        "MP405",
        request.where,
        f"look {request.id!r} is made in two, {coarse.target} {how} first: one look "
        f"does not do: {said}",
        "know its place better at the start to save a look",
    )
