"""Image of one step, as `microplan render` writes it to a file."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import MOST_TRIALS, design
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.lens.sensor import as_shown, expose, to_unit
from microplan.optics.render.fidelity import LADDER, choose
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import MODELS
from microplan.planner.assembly.assembly import State, locate_place
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.looks.full_frames import frame, seen_scene
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.folder import replace_alike
from microplan.planner.store.pictures import picture
from microplan.planner.task.task import Task
from microplan.planner.views.coarse import first_views
from microplan.planner.views.light.lit_layers import field_level
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.views import light_level
from microplan.planner.views.zooms import microscope_at

NOISE_SEED = 0  # of the one noisy frame that --noise shows
DEFAULT_MODEL = "exact"  # where neither a model nor an error is asked for


class RenderError(CallError):
    """The call cannot be met; `code` is MP4xx or MP7xx."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderCall:
    """What to render; None leaves it to the compiler's choice."""

    step: str
    magnification: float | None
    focus_um: float | None
    model: str | None
    max_image_error: float | None  # None: the task's with a trial, else no choice
    noise: bool
    trial: int | None
    out: Path


def render_step(task: Task, call: RenderCall, report: Report) -> str:
    """Write the image of a step and return a sentence about it.

    Raises
    ------
    RenderError
        If the step, the model or the trial does not exist, or the file can be no
        picture's.
    OutputError
        MP702 if the file cannot be written, MP703 if one of another kind is there.
    """
    if call.out.suffix not in (".png", ".npy"):
        message = f"{call.out}: only .png and .npy can be written"
        raise RenderError("MP702", message, call.out)
    if call.model is not None and call.model not in MODELS:
        known = ", ".join(sorted(MODELS))
        raise RenderError("MP404", f"no defocus law {call.model!r}; known: {known}")
    states = unfold(task, report)
    index = next((i for i, s in enumerate(states) if s.step.id == call.step), None)
    if index is None:
        known = ", ".join(s.step.id for s in states)
        raise RenderError("MP404", f"no step {call.step!r}; known: {known}")
    shown, said = _image(task, states, index, call, report)
    _write(call.out, shown)
    return f"{call.out}: {said}"


def _image(
    task: Task,
    states: tuple[StepState, ...],
    index: int,
    call: RenderCall,
    report: Report,
) -> tuple[FloatArray, str]:
    """Return the picture and what it shows."""
    look = next(iter(requests(task, states, index, None)), None)
    if call.trial is not None:
        if look is None:
            raise RenderError("MP404", f"step {call.step!r} has no look to try")
        return _trial(task, look, call, report)
    state = states[index].after if look is None else look.state
    scope, focus, level = _setting(task, states[index], look, state, call, report)
    return _frame(task, state, scope, focus, level, call)


def _frame(
    task: Task,
    state: State,
    scope: Microscope,
    focus_um: float,
    level: float,
    call: RenderCall,
) -> tuple[FloatArray, str]:
    """Return the whole frame of a state."""
    cell = task.workcell
    seen = seen_scene(cell, world_scene(task, state), scope, focus_um)
    model, sampling = _fidelity(seen, scope, focus_um, call)
    shown = frame(
        cell,
        seen,
        scope,
        focus_um=focus_um,
        level=level,
        model=model,
        sampling=sampling,
    )
    shown = np.clip(shown, 0.0, 1.0)
    sensor = task.workcell.camera.sensor
    if call.noise:
        rng = np.random.default_rng(NOISE_SEED)
        shown = to_unit(expose(shown, sensor, rng), sensor.bits)
    else:
        shown = as_shown(shown, sensor)
    said = f"{call.step} at {scope.magnification:.4g} x, focus {focus_um:g} um, {model}"
    return shown, said


def _fidelity(
    scene: Scene, scope: Microscope, focus_um: float, call: RenderCall
) -> tuple[str, Sampling]:
    """Return model and sampling: the cheapest for the error, if one is asked for."""
    if call.max_image_error is None:
        return call.model or DEFAULT_MODEL, Sampling()
    found = choose(
        scene,
        scope,
        focus_um=(focus_um,),
        limit=call.max_image_error,
        ladder=LADDER if call.model is None else (call.model,),
    )
    return found.model, found.sampling


def _setting(
    task: Task,
    here: StepState,
    look: Request | None,
    state: State,
    call: RenderCall,
    report: Report,
) -> tuple[Microscope, float, float]:
    """Return microscope, focus and light level, as compiled where not overridden."""
    low, high = task.workcell.optics.magnification
    zoom, focus = low, _focus_of(task, here)
    world = world_scene(task, state)
    field = field_level(
        world.background, task.workcell, microscope_at(task.workcell, low)
    )
    level = light_level(task.workcell, world.layers, task.benchmark, field)
    settings = first_views(task, look, low, report)[1] if look else ()
    if settings:
        zoom, focus = settings[0].microscope.magnification, settings[0].focus_um
        level = settings[0].light
    if call.magnification is not None:
        zoom = call.magnification
        if not low <= zoom <= high:
            raise RenderError(
                "MP404", f"magnification {zoom:g} is outside {low:g} to {high:g}"
            )
    if call.focus_um is not None:
        focus = call.focus_um
    if not math.isfinite(focus):
        raise RenderError("MP404", f"focus must be finite, got {focus}")
    return microscope_at(task.workcell, zoom), focus, level


def _focus_of(task: Task, here: StepState) -> float:
    """Return the face a step without a look is about: its target's, the held part's,
    the first part's by name, or the stage."""
    known = (here.step.target, here.after.held, *sorted(here.after.parts))
    name = next((name for name in known if name), None)
    if name is None:
        return task.workcell.stage.datum_z_um + here.after.stage.z_um
    return locate_place(task, here.after, name).z_um


def _trial(
    task: Task, look: Request, call: RenderCall, report: Report
) -> tuple[FloatArray, str]:
    """Return the region of one trial, bit for bit as the benchmark had it."""
    index = call.trial or 0
    if not 0 <= index < MOST_TRIALS:
        last = MOST_TRIALS - 1
        raise RenderError("MP404", f"trials count from 0 to {last}, got {index}")
    case = _case(task, look, call, report)
    trial = design(case, index + 1, task.seed)[index]
    if call.focus_um is not None or call.model is not None:
        raise RenderError("MP404", "--trial sets focus and model itself")
    said = (
        f"trial {index} of {look.id} at {case.microscope.magnification:.4g} x: "
        f"target {trial.dx_um:+.3g}, {trial.dy_um:+.3g} um, focus {trial.dz_um:+.3g} "
        f"um, zoom x {trial.magnification:.5g}, {trial.model}"
    )
    return image(case, trial), said


def _case(task: Task, look: Request, call: RenderCall, report: Report) -> LookCase:
    """Return the look's case at the first magnification, or the one asked for."""
    low, _ = task.workcell.optics.magnification
    limit = call.max_image_error or task.optimise.image_error()
    look, settings = first_views(task, look, low, report)
    for view in settings:
        zoom = view.microscope.magnification
        if call.magnification is None or math.isclose(zoom, call.magnification):
            return build_case(task, look, view, limit)[0]
    tried = ", ".join(f"{v.microscope.magnification:.6g}" for v in settings)
    raise RenderError("MP404", f"{look.id} is tried at {tried or 'no'} x only")


def _write(path: Path, shown: FloatArray) -> None:
    """Write 8-bit PNG, or float64 npy in 0..1."""
    if path.suffix == ".npy":
        stream = io.BytesIO()
        np.save(stream, shown)
        replace_alike(path, stream.getvalue(), head=len(np.lib.format.MAGIC_PREFIX))
        return
    ok, data = cv2.imencode(".png", picture(shown))
    if not ok:
        raise RenderError("MP702", f"{path}: the image could not be encoded", path)
    replace_alike(path, data.tobytes())
