"""Tradeoff of speed against accuracy of a task's images, `microplan tradeoff`."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from microplan.featuresel.look.scenario import LookCase, scene
from microplan.optics.layers.layer_error import layer_error
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.render.render import render
from microplan.optics.render.scene import Illumination, Scene, Window
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import write_files
from microplan.planner.task.task import Task
from microplan.planner.tradeoff.plots import Strip, round_down, strip_png, tradeoff_png
from microplan.planner.tradeoff.preview import RenderError
from microplan.planner.tradeoff.reference_images import (
    ReferenceView,
    exact_reference,
    traced_reference,
)
from microplan.planner.tradeoff.render_methods import (
    MARGINS,
    REPEATS,
    floor_ms,
    measure,
)
from microplan.planner.tradeoff.tradeoff_record import (
    StepTradeoff,
    Tradeoff,
    csv_text,
    json_text,
    table,
)
from microplan.planner.views.coarse import first_views
from microplan.planner.views.lens_errors import known_errors
from microplan.planner.views.light.layer_reach import relevant
from microplan.planner.views.light.lit_layers import field_level
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.target_views import needed_shape, target_pose
from microplan.planner.views.views import ViewPlan
from microplan.planner.views.zooms import microscope_at

FORMAT_VERSION = "1.0"
FOCUS_SIGMAS = 2.0  # as far from the nominal focus as the compiler's choice must hold
OFFSET_DEPTHS = (3.0, 8.0)  # of the strip's pictures, in depths of field
NOTE = (
    "Times are of one thread, the least of the repeats, with warm tables; "
    "they depend on the machine, and so do the fronts. Errors do not."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TradeoffCall:
    """What to measure, and where to write it."""

    step: str | None  # None: every step that looks
    max_image_error: float | None  # None: the task's
    out: Path


def write_tradeoff(
    task: Task, call: TradeoffCall, report: Report, progress: Callable[[str], None]
) -> str:
    """Measure the looks of a task, write the folder, and return a table.

    Parameters
    ----------
    task : Task
        The task.
    call : TradeoffCall
        Which steps, and where to.
    report : Report
        Receives why a look has no view.
    progress : callable
        Receives the step that is being measured.

    Raises
    ------
    RenderError
        MP404 if the step does not exist or does not look.
    OutputError
        MP702 if the folder cannot be written.
    """
    looks = _looks(task, call, report)
    write_files(call.out, {})  # before minutes are spent
    limit = call.max_image_error or task.optimise.image_error()
    found = []
    low, _ = task.workcell.optics.magnification
    for step, look in looks:
        progress(step)
        request, settings = first_views(task, look, low, report)
        if not settings:
            continue  # the report says why
        measured = _measured(task, step, request, settings[0], limit)
        found.append(measured)
        strip = strip_of(task, request, settings[0], f"{step}: {measured.target}")
        write_files(
            call.out,
            {
                f"tradeoff-{step}.png": tradeoff_png(measured),
                f"strip-{step}.png": strip_png(strip),
            },
        )
    record = _record(task, tuple(found))
    texts = {"tradeoff.csv": csv_text(record), "tradeoff.json": json_text(record)}
    write_files(call.out, {name: text.encode() for name, text in texts.items()})
    return "\n\n".join([*map(table, found), f"folder: {call.out}"])


def strip_of(task: Task, request: Request, view: ViewPlan, title: str) -> Strip:
    """Return whole frames over focus and zoom, the target in the middle.

    The stage is taken to bring it there, since at a higher zoom it may else be outside
    the frame. Light is the view's, the defocus model exact.
    """
    low, high = task.workcell.optics.magnification
    zooms = sorted({low, math.sqrt(low * high), high})
    far = [round_down(d * view.microscope.wave_depth_um) for d in OFFSET_DEPTHS]
    focus = tuple(view.focus_um + d for d in (-far[1], -far[0], 0.0, *far))
    scopes = [microscope_at(task.workcell, zoom) for zoom in zooms]
    return Strip(
        title=title,
        focus_um=focus,
        nominal_um=view.focus_um,
        magnifications=tuple(zooms),
        um_per_px=tuple(scope.um_per_px for scope in scopes),
        images=tuple(
            tuple(_frame(task, request, view, zoom, z) for z in focus) for zoom in zooms
        ),
    )


def _frame(
    task: Task, request: Request, view: ViewPlan, zoom: float, focus_um: float
) -> np.ndarray:
    """Return one frame with the target in the middle, clipped to 0..1."""
    scope = microscope_at(task.workcell, zoom)
    pose = target_pose(task, request, needed_shape(task, request)).pose
    frame = Window(
        row=-round(pose.y_um * scope.px_per_um),
        column=round(pose.x_um * scope.px_per_um),
        rows=scope.height_px,
        columns=scope.width_px,
    )
    world = world_scene(task, request.state)
    seen = Scene(
        layers=relevant(world.layers, scope, focus_um, frame),
        background=field_level(world.background, task.workcell, scope),
    )
    image = render(
        lens_scene(seen, scope, known_errors(task.workcell), focus_um),
        scope,
        focus_um=focus_um,
        window=frame,
        light=Illumination(gain=view.light),
    )
    return np.clip(image, 0.0, 1.0)


def _looks(
    task: Task, call: TradeoffCall, report: Report
) -> tuple[tuple[str, Request], ...]:
    """Return the first look of each step that is asked for."""
    states = unfold(task, report)
    found = []
    for index, here in enumerate(states):
        asked = requests(task, states, index, None)
        if asked and call.step in (None, here.step.id):
            found.append((here.step.id, asked[0]))
    if call.step is not None and not found:
        known = [s.step.id for s in states]
        if call.step in known:
            raise RenderError("MP404", f"step {call.step!r} has no look to measure")
        raise RenderError("MP404", f"no step {call.step!r}; known: {', '.join(known)}")
    return tuple(found)


def _measured(
    task: Task, step: str, request: Request, view: ViewPlan, limit: float
) -> StepTradeoff:
    """Return a look's rendering methods with times and errors."""
    case, fidelity = build_case(task, request, view, limit)
    seen = _reference_view(case)
    law = exact_reference(seen, max(*MARGINS, fidelity.sampling.margin))
    layered = traced_reference(seen, law, fidelity.sampling.margin)
    return StepTradeoff(
        step=step,
        look=request.id,
        target=case.target.name,
        magnification=case.microscope.magnification,
        focus_um=case.focus_um,
        focus_heights_um=seen.focus_um,
        **asdict(case.window),
        um_per_px=case.microscope.um_per_px,
        layers_in_view=tuple(layer.name for layer in seen.scene.layers),
        limit=limit,
        predicted_error=fidelity.predicted_error,
        predicted_layer_error=layer_error(
            seen.scene,
            case.microscope,
            focus_um=case.focus_um,
            treatment=case.treatment,
            window=case.window,
            lamp_aperture=case.lamp_aperture,
        ),
        law_oracle=law.name,
        law_oracle_error=law.error,
        oracle=layered.name,
        oracle_error=layered.error,
        floor_ms=floor_ms(case.window),
        ways=measure(seen, fidelity, case.treatment, law, layered),
    )


def _reference_view(case: LookCase) -> ReferenceView:
    """Return what the case's images show, with the target where it should be."""
    off = FOCUS_SIGMAS * case.spread.focus_sigma_um
    heights = (case.focus_um, case.focus_um - off, case.focus_um + off)
    shown = scene(case, 0.0, 0.0, 0.0)
    return ReferenceView(
        scene=lens_scene(shown, case.microscope, case.lens, case.focus_um),
        microscope=case.microscope,
        window=case.window,
        focus_um=heights if off > 0 else heights[:1],
    )


def _record(task: Task, steps: tuple[StepTradeoff, ...]) -> Tradeoff:
    """Return the record of a run, with what its times depend on."""
    return Tradeoff(
        format_version=FORMAT_VERSION,
        task=task.name,
        note=NOTE,
        machine=f"{platform.system()} {platform.machine()}",
        microplan=version("microplan"),
        python=platform.python_version(),
        numpy=version("numpy"),
        scipy=version("scipy"),
        repeats=REPEATS,
        steps=steps,
    )
