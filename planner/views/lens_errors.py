"""Errors of lens or lamp in a look: what is known, what is charged to the budget."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.lens_budget import LensRow, predict
from microplan.optics.outline.outline import Outline, place
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import Place, State
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.light.lit_layers import (
    dull_level,
    ring_lamp,
    stage_level,
)
from microplan.planner.views.targets import TargetShape, surface_of, target_layers

NM_PER_UM = 1000.0
_LOWEST = 4.0  # um aside a um of height, of a ring's light
_MOST_APERTURE = 0.99  # of the index: light from the side has no shade to compute


def known_errors(cell: Workcell) -> LensErrors:
    """Return what is known of the lens; images are made with it.

    The light's gradient has no known direction and is not in it.
    """
    return replace(
        cell.optics.lens,
        distortion_sigma=0.0,
        lateral_sigma=0.0,
        scale_sigma_per_um=0.0,
        field_curvature_sigma_per_um=0.0,
        apertures=(),
    )


def lamp_aperture(cell: Workcell, microscope: Microscope) -> float | None:
    """Return the aperture of coaxial light, None for light from elsewhere.

    That of the objective, or the workcell's coherence times it: light that comes
    through the objective is not wider, whatever the condenser.
    """
    if cell.light.kind != "coaxial":
        return None
    share = coaxial_share(cell)
    return min(share * microscope.aperture, _MOST_APERTURE * microscope.medium_index)


def lamp_slope(cell: Workcell, microscope: Microscope) -> float:
    """Return how far aside the lamp's steepest rays go a um of height, 0 from below.

    Of a ring near the horizon, `_LOWEST`: what stands farther off shades too little.
    """
    if (aperture := lamp_aperture(cell, microscope)) is not None:
        return math.tan(math.asin(aperture / microscope.medium_index))
    ring = ring_lamp(cell)
    if ring is None:
        return 0.0
    return math.tan(min(ring.high_rad, math.atan(_LOWEST)))


def coaxial_share(cell: Workcell) -> float:
    """Return the aperture of coaxial light over that of the objective, at most 1.

    The most that the workcell's coherence allows.
    """
    coherence = cell.optics.coherence
    return 1.0 if coherence is None else min(coherence.most, 1.0)


def lens_rows(
    task: Task, state: State, shape: TargetShape, target_at: Place, scope: Microscope
) -> tuple[LensRow, ...]:
    """Return what the lens does to the target of a look, effect by effect.

    The target is taken to be out of focus by one sigma of the task's benchmark.
    """
    pose, (left, low, right, high) = target_at.pose, shape.box_um
    corners = [
        (pose.x_um + x, pose.y_um + y) for x in (left, right) for y in (low, high)
    ]
    body, levels = _body(task, state, shape), _levels(task, shape)
    outline = None
    if body is not None and levels[0] < levels[1]:
        outline = place(body, pose.x_um, pose.y_um, pose.theta_rad)
    return predict(
        _all_errors(task, shape),
        scope,
        corners,
        defocus_um=task.benchmark.focus_sigma_um,
        outline=outline,
        levels=levels,
    )


def _body(task: Task, state: State, shape: TargetShape) -> Outline | None:
    """Return what has a centroid of light in the target's frame; a hole has none."""
    if shape.kind == "jaws" or not shape.bright:
        return None
    faces = {layer.name: layer.outline for layer in target_layers(task, state, shape)}
    return faces[shape.body]


def _levels(task: Task, shape: TargetShape) -> tuple[float, float]:
    """Return what is sent on both sides of the target's edges, the darker first."""
    part, cell = task.parts.get(shape.owner), task.workcell
    if part is None:
        pair = (
            dull_level(task, shape.owner, cell.tools[shape.owner].reflectance),
            stage_level(cell),
        )
    else:
        face = surface_of(part, shape)
        around = stage_level(cell)
        if face.around is not None and not cell.light.is_transmitted:
            around = dull_level(task, part.name, face.around)
        pair = (dull_level(task, shape.body, face.reflectance), around)
    return (min(pair), max(pair))


def middle_sigma_um(cell: Workcell, microscope: Microscope, target_at: Place) -> float:
    """Return how far the unknown distortion moves the middle of a target, one sigma."""
    lens = cell.optics.lens
    rows = predict(lens, microscope, [(target_at.pose.x_um, target_at.pose.y_um)])
    row = next(row for row in rows if row.effect == "radial distortion")
    return row.sigma_nm / NM_PER_UM


def _all_errors(task: Task, shape: TargetShape) -> LensErrors:
    """Return the lens' errors with the light's gradient and the part's edge tolerance.

    A gradient of any direction counts half along each axis; a profile tolerance is
    uniform within.
    """
    cell = task.workcell
    part = task.parts.get(shape.owner)
    tolerance_um = 0.0 if part is None else part.profile_tolerance_um
    return replace(
        cell.optics.lens,
        gradient_sigma=cell.light.gradient / math.sqrt(2),
        edge_offset_sigma_um=tolerance_um / math.sqrt(3),
    )
