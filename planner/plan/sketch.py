"""Sketch of a task: what its looks show, without a trial."""

from __future__ import annotations

from dataclasses import dataclass

from microplan.planner.assembly.step_states import StepState
from microplan.planner.looks.full_frames import nominal_picture
from microplan.planner.looks.records import scene_record
from microplan.planner.looks.scenario import seen_layers
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.pictures import Picture
from microplan.planner.task.task import Task
from microplan.planner.views.coarse import first_views
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.scenes import look_scene
from microplan.planner.views.target_views import needed_shape, target_pose
from microplan.planner.views.views import ViewPlan
from microplan.schemas import plan as p
from microplan.schemas.files.evidence import LookScene


@dataclass(frozen=True, slots=True, kw_only=True)
class Sketched:
    """A look of a sketch, with the files that belong to it."""

    look: p.SketchedLook
    picture: Picture
    placed: LookScene


def sketch_looks(
    task: Task, states: tuple[StepState, ...], report: Report, memo: Memo
) -> tuple[Sketched, ...]:
    """Return what each look of a task shows, at the setting that is tried first.

    A look without a setting is left out; `report` says why. Where only a coarse look
    before it makes one possible, it is the coarse one.
    """
    zoom, _ = task.workcell.optics.magnification
    found = []
    for index, here in enumerate(states):
        for asked in requests(task, states, index, None):
            first, settings = first_views(task, asked, zoom, report)
            if settings:
                zoom = settings[0].microscope.magnification
                found.append(_sketched(task, here.step.id, first, settings[0], memo))
    return tuple(found)


def _sketched(
    task: Task, step: str, request: Request, view: ViewPlan, memo: Memo
) -> Sketched:
    """Return what one look shows."""
    shape, scope = needed_shape(task, request), view.microscope
    spot, path = target_pose(task, request, shape), f"images/{request.id}.png"
    image = nominal_picture(task, request, view, memo)
    layers = seen_layers(task, request, view)
    look = p.SketchedLook(
        id=request.id,
        step=step,
        target=shape.name,
        view=p.View(
            magnification=scope.magnification,
            focus_um=view.focus_um,
            focus_stops_um=(),
            light=view.light,
            field_um=scope.field_um,
            um_per_px=scope.um_per_px,
            follows=spot.followed_um > 0,
        ),
        scene=scene_record(task, request, scope, layers, shape, path, image),
    )
    placed = look_scene(task, request.state, request.id, shape, spot)
    return Sketched(look=look, picture=image, placed=placed)
