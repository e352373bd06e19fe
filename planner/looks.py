"""One look compiled: trials, choice, and what the plan says of them."""

from __future__ import annotations

from dataclasses import dataclass

from featuresel.case import LookCase
from featuresel.contest import compete
from featuresel.score import Score
from featuresel.select import Selection
from featuresel.trials import Map
from featuresel.usable import usable_range
from optics.fidelity import Fidelity
from planner.cases import build_case
from planner.diagnostics import Report
from planner.effects import effect_rows
from planner.frames import frame, seen_scene
from planner.inputs.task import Task
from planner.lens import (
    middle_offset_um,
    middle_sigma_um,
)
from planner.model.requests import Request
from planner.model.scenes import world_scene
from planner.model.sightings import needed_shape, spot_of, views
from planner.model.views import ViewPlan
from planner.pictures import Picture, picture
from planner.presets import Effort
from planner.records import evidence, measure_record, scene_record, view_record
from planner.tried import Arrays, Tried, arrays_of
from schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """What the whole compile shares: how much to spend, and the map that spends it."""

    effort: Effort
    max_image_error: float
    map: Map


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledLook:
    """A look as the plan has it, with the files that belong to it."""

    look: p.Look
    case: LookCase
    picture: Picture
    arrays: Arrays
    distortion_sigma_um: float  # of the middle of the target, by the lens
    coherence_um: float  # how far partly coherent light moves it


def compile_look(
    task: Task,
    request: Request,
    effects: Effects,
    current: float,
    report: Report,
) -> CompiledLook | None:
    """Return the look, None if there is a reason why it cannot be done.

    Magnifications are tried in order of preference until a chain of routines meets the
    tolerance; `current` is the one the microscope is at.
    """
    failed: list[tuple[ViewPlan, Selection]] = []
    for view in views(task, request, current, report):
        case, fidelity = build_case(task, request, view, effects.max_image_error)
        trial = _benchmark(task, case, fidelity, effects)
        if trial.selection.chosen is not None:
            return _finish(task, request, trial, trial.selection.chosen, effects)
        failed.append((view, trial.selection))
    if failed:
        _report_failure(request, failed, report)
    return None


def _benchmark(
    task: Task, case: LookCase, fidelity: Fidelity, effects: Effects
) -> Tried:
    """Return the choice among all chains, with the trials behind it."""
    found = compete(
        case,
        root_seed=task.seed,
        most=effects.effort.trials,
        thorough=effects.effort.thorough,
        limited=effects.effort.limited,
        map=effects.map,
    )
    return Tried(
        case=case,
        fidelity=fidelity,
        prepared=found.prepared,
        outcomes=found.outcomes,
        scores=found.scores,
        selection=found.selection,
    )


def _finish(
    task: Task, request: Request, tried: Tried, chosen: Score, effects: Effects
) -> CompiledLook:
    """Return what the plan says of a look whose chain is chosen."""
    case, shape = tried.case, needed_shape(task, request)
    usable = usable_range(
        case,
        tried.prepared,
        chosen.chain,
        root_seed=task.seed,
        draws=effects.effort.range_draws,
        map=effects.map,
    )
    image = reference_image(task, request, case)
    name = f"images/{request.id}.png"
    return CompiledLook(
        look=p.Look(
            id=request.id,
            target=shape.name,
            view=view_record(task, request, case, usable.focus_um),
            scene=scene_record(task, request, case, shape, name, image),
            effects=effect_rows(task, request, tried),
            measure=measure_record(request, shape, tried, chosen, usable),
            evidence=evidence(tried, chosen),
        ),
        case=case,
        picture=image,
        arrays=arrays_of(request.id, tried),
        distortion_sigma_um=middle_sigma_um(
            task.workcell, case.microscope, spot_of(task, request, shape)
        ),
        coherence_um=middle_offset_um(task, request.state, shape, case.microscope),
    )


def reference_image(task: Task, request: Request, case: LookCase) -> Picture:
    """Return the whole frame at the nominal state by the exact law, 8 bit.

    What the case's fidelity was chosen for is its region.
    """
    cell, scope = task.workcell, case.microscope
    seen = seen_scene(cell, world_scene(task, request.state), scope, case.focus_um)
    image = frame(cell, seen, scope, focus_um=case.focus_um, level=case.light.gain)
    return picture(image)


def _report_failure(
    request: Request, failed: list[tuple[ViewPlan, Selection]], report: Report
) -> None:
    """Report that no chain is good enough, with the best reason of each view."""
    view, selection = failed[-1]
    reasons = "; ".join(
        f"{' > '.join(chain)}: {why}" for chain, why in selection.reasons
    )
    report.refuse(
        "MP501",
        request.where,
        f"look {request.id!r}: no routine finds {request.target} well enough at "
        f"{view.microscope.magnification:.4g} x: {reasons}",
        selection.advice,
    )
