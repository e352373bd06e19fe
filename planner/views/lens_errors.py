"""Errors of lens or lamp in a look: what is known, what is charged to the budget."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.featuresel.routines.contract import TargetKind
from microplan.optics.coherence.edge_offsets import ring_shifts_um
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.lens_budget import LensRow, predict
from microplan.optics.outline.outline import Outline, place
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import Place, State
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.targets import TargetShape, surface_of, target_layers

NM_PER_UM = 1000.0
_MOST_APERTURE = 0.99  # of the index: light from the side has no shade to compute
SYMMETRIC: tuple[TargetKind, ...] = ("circle", "jaws")


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
    share = min(cell.optics.coherence or 1.0, 1.0)
    return min(share * microscope.aperture, _MOST_APERTURE * microscope.medium_index)


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
    """Return the reflectances on both sides of the target's edges, the darker first."""
    part, cell = task.parts.get(shape.owner), task.workcell
    if part is None:
        pair = (cell.tools[shape.owner].reflectance, cell.stage.reflectance)
    else:
        face = surface_of(part, shape)
        around = cell.stage.reflectance if face.around is None else face.around
        pair = (face.reflectance, around)
    return (min(pair), max(pair))


def middle_sigma_um(cell: Workcell, microscope: Microscope, target_at: Place) -> float:
    """Return how far the unknown distortion moves the middle of a target, one sigma."""
    lens = cell.optics.lens
    rows = predict(lens, microscope, [(target_at.pose.x_um, target_at.pose.y_um)])
    row = next(row for row in rows if row.effect == "radial distortion")
    return row.sigma_nm / NM_PER_UM


def middle_offset_um(
    task: Task, state: State, shape: TargetShape, microscope: Microscope
) -> float:
    """Return how far partly coherent light moves the middle of a target in focus.

    Holes, posts and jaws have a centre of symmetry, which stays.
    """
    coherence, body = task.workcell.optics.coherence, _body(task, state, shape)
    dark, bright = _levels(task, shape)
    if not coherence or body is None or shape.kind in SYMMETRIC or dark == bright:
        return 0.0
    shifts = ring_shifts_um(
        body, coherence, microscope, reflectance=bright, background=dark
    )
    return max(math.hypot(*shift) for shift in shifts)


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
