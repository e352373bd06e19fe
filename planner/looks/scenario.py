"""A measurement look as a case for trials: scene, target, uncertainties, optics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.scenario import LookCase, TrialSpread
from microplan.featuresel.routines.contract import Target
from microplan.optics.layers.layer_error import choose_layers
from microplan.optics.layers.wall_error import most_shade_error
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.outline.outline import Outline, place
from microplan.optics.outline.tolerant_order import above
from microplan.optics.render.fidelity import Fidelity, choose
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import (
    Place,
    bodies,
)
from microplan.planner.looks.picture_errors import discrepancy
from microplan.planner.looks.trial_spreads import (
    sigma_theta_rad,
    stated_spread,
    together_um,
    tried_spread,
)
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.lens_errors import known_errors, lamp_aperture, lamp_slope
from microplan.planner.views.light.layer_reach import lit
from microplan.planner.views.light.lit_layers import (
    asks_for_walls,
    field_level,
    looks_bright,
    ring_lamp,
    stage_level,
)
from microplan.planner.views.light.unknown_walls import unknown_surfaces
from microplan.planner.views.requests import ANGLE_RAD, PERIOD_SHARE, Request
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.target_views import needed_shape, search_um, target_pose
from microplan.planner.views.targets import TargetShape, target_edges, target_layers
from microplan.planner.views.views import SEARCH_SIGMAS, ViewPlan

MOST_TOGETHER = 4  # features that one look measures
# of the look's tolerances that each of them has: their mean is as much better
SHARE_TOGETHER = math.sqrt(MOST_TOGETHER)
_FOCUS_SIGMAS = 2.0  # a model must hold so far from the nominal focus


def build_case(
    task: Task,
    request: Request,
    view: ViewPlan,
    max_image_error: float,
    memo: Memo = EVERY_TIME,
) -> tuple[LookCase, Fidelity]:
    """Return the case of a look for trials, with the fidelity of its rendering."""
    shape = needed_shape(task, request)
    spot = target_pose(task, request, shape)
    static, moving = _layers(task, request, shape, view)
    scope = view.microscope
    spread = replace(
        tried_spread(task, request, spot, static), together_um=together_um(view, spot)
    )
    stated = stated_spread(task, request, spot, spread)
    lens = known_errors(task.workcell)
    background = field_level(stage_level(task.workcell), task.workcell, scope)
    shown = Scene(
        layers=static + tuple(_placed(layer, spot) for layer in moving),
        background=background,
        background_z_um=task.workcell.stage.datum_z_um + request.state.stage.z_um,
    )
    imaged = lens_scene(shown, scope, lens, view.focus_um)
    fidelity = memo.call(
        choose,
        imaged,
        scope,
        focus_um=_focus_range(view, spread, stated),
        limit=max_image_error,
        window=view.region,
    )
    lamp = _lamp(task.workcell, shown, view, max_image_error, memo)
    case = LookCase(
        key=f"{task.name}/{request.id}@{scope.magnification:.6g}",
        static=static,
        moving=moving,
        background=background,
        x_um=spot.pose.x_um,
        y_um=spot.pose.y_um,
        theta_rad=spot.pose.theta_rad,
        theta_any=spot.sigma_theta_rad >= math.pi,
        microscope=scope,
        focus_um=view.focus_um,
        light=Illumination(gain=view.light),
        window=view.region,
        sensor=task.workcell.camera.sensor,
        target=_target(task, request, shape, spot, scope, view.region),
        model=fidelity.model,
        sampling=fidelity.sampling,
        lens=lens,
        lamp_aperture=lamp,
        ring=ring_lamp(task.workcell),
        background_z_um=shown.background_z_um,
        treatment="joint"
        if lamp is not None or asks_for_walls(task.workcell)
        else _treatment(imaged, view, (spread, stated), max_image_error),
        tolerance_um=request.tolerance_um or scope.um_per_px,
        tolerance_theta_rad=_angle_tolerance(request, shape),
        spread=spread,
        stated=stated,
    )
    surfaces = unknown_surfaces(case, bodies(task, request.state), task.workcell.tools)
    case = replace(case, surfaces=surfaces)
    return replace(case, discrepancy=discrepancy(task.workcell, case, memo)), fidelity


def feature_case(
    task: Task,
    request: Request,
    case: LookCase,
    shape: TargetShape,
    memo: Memo = EVERY_TIME,
) -> LookCase:
    """Return a look at another feature of the target's body, through the same region.

    Scene, optics and light are those of `case`. One of several features may be as many
    times less accurate as their mean is better. It lies as far off as the target does,
    and as it swings about the target in the trials.
    """
    target = needed_shape(task, request)
    arm_um = math.dist(shape.center_um, target.center_um)
    swing_um = min(case.spread.pose_sigma_theta_rad, 1.0) * arm_um
    # the sum, not the root of squares: extreme trials have both at once
    sigma_um = target_pose(task, request, target).sigma_xy_um + swing_um
    spot = replace(target_pose(task, request, shape), sigma_xy_um=sigma_um)
    # a round one has no angle: others do
    angle = None if shape.symmetry == 0 else _angle_tolerance(request, shape)
    c, s = math.cos(case.theta_rad), math.sin(case.theta_rad)
    x, y = spot.pose.x_um - case.x_um, spot.pose.y_um - case.y_um
    back = (-(c * x + s * y), s * x - c * y)  # of its origin, in the part's axes
    wide_um = math.hypot(spot.sigma_xy_um, task.benchmark.pose_sigma_xy_um)
    far_um = search_um(task, spot)
    found = replace(
        case,
        key=f"{case.key}/{shape.name}",
        moving=tuple(
            replace(layer, outline=place(layer.outline, *back)) for layer in case.moving
        ),
        x_um=spot.pose.x_um,
        y_um=spot.pose.y_um,
        target=_target(task, request, shape, spot, case.microscope, case.window),
        tolerance_um=case.tolerance_um * SHARE_TOGETHER,
        tolerance_theta_rad=None
        if case.tolerance_theta_rad is None or angle is None
        else angle * SHARE_TOGETHER,
        spread=replace(case.spread, pose_sigma_xy_um=wide_um, search_um=far_um),
        stated=replace(
            case.promised, pose_sigma_xy_um=spot.sigma_xy_um, search_um=far_um
        ),
    )
    return replace(found, discrepancy=discrepancy(task.workcell, found, memo))


def _lamp(
    cell: Workcell, shown: Scene, view: ViewPlan, max_image_error: float, memo: Memo
) -> float | None:
    """Return the lamp's aperture if leaving its shade out would cost too much."""
    aperture = lamp_aperture(cell, view.microscope)
    if aperture is None:
        return None
    error = memo.call(
        most_shade_error,
        shown,
        view.microscope,
        focus_um=view.focus_um,
        lamp_aperture=aperture,
        window=view.region,
    )
    return aperture if above(error, max_image_error) else None


def _treatment(
    imaged: Scene,
    view: ViewPlan,
    spreads: Sequence[TrialSpread],
    max_image_error: float,
) -> str:
    """Return the treatment of layers; the more expensive one must keep the limit.

    In shaded or other light nothing is traced: that takes seconds an image, of top
    faces alone.
    """
    found = choose_layers(
        imaged,
        view.microscope,
        focus_um=_focus_range(view, *spreads),
        limit=max_image_error,
        window=view.region,
    )
    return found.treatment if found.keeps_limit else "joint"


def _focus_range(view: ViewPlan, *spreads: TrialSpread) -> tuple[float, ...]:
    """Return the focus heights that a fidelity must hold for."""
    off = _FOCUS_SIGMAS * max(spread.focus_sigma_um for spread in spreads)
    heights = (view.focus_um, view.focus_um - off, view.focus_um + off)
    return heights if off > 0 else heights[:1]


def _placed(layer: Layer, spot: Place) -> Layer:
    """Return a layer of the target's frame in the world."""
    outline = place(layer.outline, spot.pose.x_um, spot.pose.y_um, spot.pose.theta_rad)
    return replace(layer, outline=outline)


def seen_layers(task: Task, request: Request, view: ViewPlan) -> tuple[Layer, ...]:
    """Return the layers that are seen in a look's region, or shade what is."""
    scope, scene = view.microscope, world_scene(task, request.state)
    slope = lamp_slope(task.workcell, scope)
    return lit(scene, scope, view.focus_um, view.region, slope)


def _layers(
    task: Task, request: Request, shape: TargetShape, view: ViewPlan
) -> tuple[tuple[Layer, ...], tuple[Layer, ...]]:
    """Return the layers that are fixed in trials, and those that move."""
    seen = seen_layers(task, request, view)
    known = {layer.name: layer for layer in seen}
    own = {name for name in known if name.partition(".")[0] == shape.owner}
    static = tuple(layer for layer in seen if layer.name not in own)
    moving = tuple(
        replace(known[layer.name], outline=layer.outline)
        for layer in target_layers(task, request.state, shape)
        if layer.name in own
    )
    return static, moving


def _carrying(task: Task, request: Request, shape: TargetShape) -> list[Outline]:
    """Return the outlines that hold the target's edges, in the target's frame."""
    if shape.owner in task.workcell.tools:
        return [layer.outline for layer in target_layers(task, request.state, shape)]
    return [target_edges(task, shape)]


def _target(
    task: Task,
    request: Request,
    shape: TargetShape,
    spot: Place,
    scope: Microscope,
    region: Window,
) -> Target:
    """Return the target in pixels of the region, with its contour."""
    k = scope.px_per_um
    target = Target(
        name=shape.name,
        kind=shape.kind,
        column=(scope.width_px - 1) / 2 + k * spot.pose.x_um - region.column,
        row=(scope.height_px - 1) / 2 - k * spot.pose.y_um - region.row,
        theta_rad=spot.pose.theta_rad + shape.angle_rad,
        px_per_um=k,
        search_px=k * search_um(task, spot),
        theta_range_rad=min(math.pi, SEARCH_SIGMAS * sigma_theta_rad(task, spot)),
        symmetry=shape.symmetry,
        bright=looks_bright(task, shape),
        parameters=shape.parameters,
    )
    return with_contour(target, _carrying(task, request, shape))


def _angle_tolerance(request: Request, shape: TargetShape) -> float | None:
    """Return the tolerance of the angle, rad, None if it need not be known."""
    if request.needs_angle_rad is not None:
        return request.needs_angle_rad  # of a round target by other features
    if shape.symmetry == 0:
        return None  # it has none
    if not request.wants_angle or shape.kind == "jaws":
        return None
    if shape.symmetry > 1:
        return PERIOD_SHARE * 2 * math.pi / shape.symmetry
    return ANGLE_RAD
