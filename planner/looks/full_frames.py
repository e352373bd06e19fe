"""Rendered full camera frames of an assembly state."""

from __future__ import annotations

from dataclasses import replace

from microplan.arrays import FloatArray
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.sensor import as_shown
from microplan.optics.light.lit_image import render_lit
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Scene
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.store.pictures import Picture, picture
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.lens_errors import known_errors, lamp_aperture, lamp_slope
from microplan.planner.views.light.layer_reach import lit
from microplan.planner.views.light.lit_layers import ring_lamp, through
from microplan.planner.views.requests import Request
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.views import ViewPlan


def nominal_picture(
    task: Task, request: Request, view: ViewPlan, memo: Memo = EVERY_TIME
) -> Picture:
    """Return the whole frame at a setting of the microscope, 8 bit.

    As the camera counts it, its response included.
    """
    cell, scope = task.workcell, view.microscope
    seen = seen_scene(cell, world_scene(task, request.state), scope, view.focus_um)
    image = frame(
        cell, seen, scope, focus_um=view.focus_um, level=view.light, memo=memo
    )
    return picture(as_shown(image, cell.camera.sensor))


def seen_scene(
    cell: Workcell, scene: Scene, scope: Microscope, focus_um: float
) -> Scene:
    """Return the scene that reaches the frame, as the lens images it."""
    layers = lit(scene, scope, focus_um, full(scope), lamp_slope(cell, scope))
    shown = replace(through(cell, scene, scope), layers=layers)
    return lens_scene(shown, scope, known_errors(cell), focus_um)


def frame(
    cell: Workcell,
    scene: Scene,
    scope: Microscope,
    *,
    focus_um: float,
    level: float,
    model: str = "exact",
    sampling: Sampling | None = None,
    memo: Memo = EVERY_TIME,
) -> FloatArray:
    """Return the noise-free frame of a scene by `seen_scene`, (rows, columns).

    Coaxial light is shaded by higher bodies.
    """
    return memo.call(
        render_lit,
        scene,
        scope,
        focus_um=focus_um,
        lamp_aperture=lamp_aperture(cell, scope),
        ring=ring_lamp(cell),
        model=model,
        light=Illumination(gain=level),
        sampling=sampling or Sampling(),
    )
