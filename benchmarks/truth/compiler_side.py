"""Looks of an example as the compiler's trials render them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.optics.layers.diffraction.face_waves import wave_changes
from microplan.optics.layers.layer_edges import faces, meeting_points
from microplan.optics.layers.layer_error import LayerChoice, layer_error
from microplan.optics.layers.ray_probes import light_shares, probes
from microplan.optics.ledger import CONTRAST, Imaged, ledger
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.render.fidelity import Fidelity
from microplan.optics.render.scene import Illumination, Scene, Window
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.finishes import SurfaceFinish
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Tool
from microplan.planner.views.lens_errors import lamp_aperture
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.target_views import views
from microplan.schemas.plan import Look

MAX_IMAGE_ERROR = 0.002  # both examples' own
RAYS = 128  # a point, for the light on it
SAME = 1e-5  # relative: magnifications come back in six digits
# rows of the ledger that this benchmark's truth has an answer to: both roads leave out
# coherence, polarisation, the light's spectrum and the lens' errors
IMAGE_ROWS = (
    "defocus law", "layers of different height", "shade of higher bodies",
    "pixel integration", "band and tile", "side walls",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """How all bodies reflect."""

    wall: float  # reflectance of their sides; 0: black
    finish: float = 0.0  # share of a top face's light that a mirror gives back


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialCase:
    """A look of a plan as a case for trials."""

    task: Task
    case: LookCase
    fidelity: Fidelity


def task_of(path: Path, surface: Surface) -> Task:
    """Return a task whose bodies all state one surface."""
    task = load_task(path, Report())
    if task is None:
        raise RuntimeError(f"{path} cannot be read")
    stated = SurfaceFinish(
        wall=(surface.wall, surface.wall),
        finish=(surface.finish, surface.finish),
        stated=(True, True),
    )
    parts = {
        name: replace(
            part,
            surface=stated,
            posts={k: replace(p, surface=stated) for k, p in part.posts.items()},
        )
        for name, part in task.parts.items()
    }
    tools: Mapping[str, Tool] = {
        name: replace(tool, surface=stated)
        for name, tool in task.workcell.tools.items()
    }
    return replace(task, parts=parts, workcell=replace(task.workcell, tools=tools))


def trial_cases(
    task: Task, looks: Mapping[str, Look]
) -> Iterator[tuple[str, TrialCase]]:
    """Yield the cases of looks at their plan's magnification, focus and region."""
    states = unfold(task, Report())
    for index in range(len(states)):
        for request in requests(task, states, index, 1.0):
            if request.id in looks:
                yield request.id, _case(task, request, looks[request.id])


def _case(task: Task, request: Request, look: Look) -> TrialCase:
    """Return one look's case."""
    zoom = look.view.magnification
    settings = views(task, request, zoom, Report())
    view = next(
        v for v in settings if abs(v.microscope.magnification / zoom - 1) < SAME
    )
    case, fidelity = build_case(task, request, view, MAX_IMAGE_ERROR)
    region, light = look.measure.region, Illumination(gain=look.view.light)
    seen = replace(
        case,
        focus_um=look.view.focus_um,
        light=light,
        window=Window(
            row=region.row, column=region.column, rows=region.rows,
            columns=region.columns,
        ),
    )  # fmt: skip
    return TrialCase(task=task, case=seen, fidelity=fidelity)


def trial_image(case: LookCase) -> FloatArray:
    """Return a look's region as trials have it, (rows, columns) of full scale."""
    return nominal_render(case)()


def edge_points(made: TrialCase) -> FloatArray:
    """Return where edges of two heights come near in an image, (N, 2) um."""
    case = made.case
    found = faces(_shown(case), case.microscope, case.focus_um, case.window)
    return meeting_points(found, case.microscope, case.window).at_um


def expected_errors(made: TrialCase, at_um: FloatArray) -> FloatArray:
    """Return the diffraction error at points (N, 2) of the plane in focus.

    Of what the ledger has for layers the part that no ray shows, by the waves that it
    is predicted from, (N,) of full scale, >= 0.
    """
    return np.abs(wave_changes_at(made, at_um))


def wave_changes_at(
    made: TrialCase, at_um: FloatArray, away_um: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Return what diffraction from body to body changes at points (N, 2), um.

    (N,) of full scale, the target so far from its nominal place.
    """
    case = made.case
    if not len(at_um) or case.lamp_aperture is None:
        return np.zeros(len(at_um))
    shown = _shown(case, away_um)
    found = faces(shown, case.microscope, case.focus_um, case.window)
    rasters = probes(case.microscope, found, at_um, are_lit=True)
    light = light_shares(rasters, case.microscope, case.lamp_aperture, at_um, RAYS)
    changes = wave_changes(rasters, light, shown.background, case.microscope, at_um)
    return case.light.gain * changes


def _shown(case: LookCase, away_um: tuple[float, float] = (0.0, 0.0)) -> Scene:
    """Return a look's scene as its lens shows it, the target so far from nominal."""
    placed = scene(case, *away_um, 0.0)
    return lens_scene(placed, case.microscope, case.lens, case.focus_um)


def predicted(made: TrialCase, *, by_waves: bool) -> float:
    """Return the error of a look's image by the compiler's ledger, of full scale.

    The sum of what single effects may cost: the ledger has no joint one. Diffraction
    from one body to another is left out where nothing by waves answers to it: neither
    road's rays have it.
    """
    case = made.case
    shown = _shown(case)
    error = layer_error(
        shown, case.microscope, focus_um=case.focus_um, treatment=case.treatment,
        window=case.window, lamp_aperture=case.lamp_aperture, diffracts=by_waves,
    )  # fmt: skip
    rows = ledger(
        Imaged(
            scene=shown,
            microscope=case.microscope,
            focus_um=case.focus_um,
            window=case.window,
            fidelity=made.fidelity,
            layering=LayerChoice(
                treatment=case.treatment, predicted_error=error,
                limit=MAX_IMAGE_ERROR, refused=(),
            ),
            lamp_aperture=lamp_aperture(made.task.workcell, case.microscope),
            is_shaded=case.lamp_aperture is not None,
        )
    )  # fmt: skip
    found = [r.predicted_error for r in rows if r.effect in IMAGE_ROWS]
    if any(r.unit != CONTRAST for r in rows if r.effect in IMAGE_ROWS):
        raise ValueError("an image's row of the ledger is in another unit")
    total = float(np.sum([error for error in found if error is not None]))
    return case.light.gain * total
