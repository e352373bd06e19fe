"""A look that is decided, as the plan has it, with the files that belong to it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bias_prediction import predict_bias
from microplan.featuresel.trials.usable_range import usable_range
from microplan.planner.looks.chosen_sets import ChosenSet
from microplan.planner.looks.effects import effect_rows
from microplan.planner.looks.evaluation import Arrays, Evaluation, arrays_of
from microplan.planner.looks.evidence import evidence_of
from microplan.planner.looks.full_frames import frame, seen_scene
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.measures import (
    MeasuredFeature,
    depth_record,
    look_key,
    measure_record,
)
from microplan.planner.looks.records import (
    evidence,
    scene_record,
    together_record,
    view_record,
)
from microplan.planner.looks.scale_free_sigma import sigma_without_scale_um
from microplan.planner.looks.shot import LookFigures
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.store.pictures import Picture, picture
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import middle_offset_um, middle_sigma_um
from microplan.planner.views.look_scenes import look_scene
from microplan.planner.views.requests import Request
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.target_views import target_pose
from microplan.planner.views.targets import TargetShape
from microplan.planner.views.view_verdict import view_verdict
from microplan.schemas import plan as p
from microplan.schemas.files.scenes import LookScene
from microplan.schemas.plan.views import ZoomTried


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledLook:
    """A look as the plan has it, with the files that belong to it."""

    look: p.Look
    case: LookCase
    picture: Picture
    arrays: Arrays
    distortion_sigma_um: float  # of the middle of the target, by the lens
    coherence_um: float  # how far partly coherent light moves it
    placed: LookScene
    found: tuple[MeasuredFeature, ...] = ()  # the features measured, the target first
    steady_um: float = math.inf  # `Sighted.steady_um`
    shot: LookFigures | None = None  # what reports show of it


@dataclass(frozen=True, slots=True, kw_only=True)
class LookDecision:
    """What a look measures, and what was tried before that was settled."""

    tried: Evaluation  # of its target
    found: tuple[MeasuredFeature, ...]  # the features measured, the target first
    rows: tuple[p.FeatureRow, ...]  # of all features
    together: ChosenSet | None  # None: the target alone
    refused: tuple[ZoomTried, ...]  # magnifications, before the one that does


def measured(
    job: LookProblem,
    tried: Evaluation,
    shape: TargetShape | None = None,
    sigma_um: float | None = None,
) -> MeasuredFeature:
    """Return a feature with the range and the bias of its chain.

    Raises
    ------
    ValueError
        If no chain was chosen.
    """
    case, chosen, effects = tried.case, tried.selection.chosen, job.effects
    if chosen is None:
        raise ValueError("no chain was chosen")
    seed = job.task.seed
    usable = effects.memo.call(
        usable_range,
        case,
        tried.prepared,
        chosen.chain,
        root_seed=seed,
        draws=effects.effort.range_draws,
        map=effects.map,
    )
    only = replace(tried.prepared, chains=(chosen.chain,))
    curves = effects.memo.call(
        predict_bias, case, only, root_seed=seed, map=effects.map
    )
    return MeasuredFeature(
        shape=shape or job.shape,
        tried=tried,
        chosen=chosen,
        usable=usable,
        curve=curves.get(chosen.chain),
        depth=effects.memo.call(depth_record, case, usable)
        if effects.effort.limited
        else None,
        sigma_um=sigma_um,
    )


def compiled(job: LookProblem, decided: LookDecision) -> CompiledLook:
    """Return what the plan says of a look, with its files."""
    task, request, shape = job.task, job.request, job.shape
    case, memo, found = decided.tried.case, job.effects.memo, decided.found
    image = reference_image(task, request, case, memo)
    spot = target_pose(task, request, shape)
    return CompiledLook(
        look=_look(job, decided, image),
        case=case,
        picture=image,
        arrays=_arrays(job, found),
        distortion_sigma_um=middle_sigma_um(task.workcell, case.microscope, spot),
        coherence_um=middle_offset_um(task, request.state, shape, case.microscope),
        placed=look_scene(task, request.state, request.id, shape, spot),
        found=found,
        steady_um=_steady_um(job, decided),
        shot=evidence_of(task, request, found, memo),
    )


def _look(job: LookProblem, decided: LookDecision, image: Picture) -> p.Look:
    """Return the look as `plan.json` has it."""
    task, request, shape, found = job.task, job.request, job.shape, decided.found
    tried, case = decided.tried, decided.tried.case
    first, *others = [measure_record(request, shape, each) for each in found]
    usable = {each.shape.name: each.usable.focus_um for each in found}
    view = view_record(task, request, case, list(usable.values()))
    path, together = f"images/{request.id}.png", decided.together
    return p.Look(
        id=request.id,
        target=shape.name,
        view=view,
        scene=scene_record(task, request, case, shape, path, image),
        effects=effect_rows(task, request, tried, job.effects.memo),
        measure=first,
        evidence=evidence(
            found[0].tried, found[0].chosen, decided.rows, case.tolerance_um
        ),
        others=tuple(others),
        together=None if together is None else together_record(together),
        verdict=view_verdict(task, request, view, usable, decided.refused),
    )


def _arrays(job: LookProblem, found: Iterable[MeasuredFeature]) -> Arrays:
    """Return the arrays of all features' routines, by their path."""
    return {
        path: arrays
        for each in found
        for path, arrays in arrays_of(
            look_key(job.request, job.shape, each.shape), each.tried
        ).items()
    }


def _steady_um(job: LookProblem, decided: LookDecision) -> float:
    """Return `CompiledLook.steady_um`; it is not known of several features."""
    if decided.together is not None:
        return math.inf
    first = decided.found[0]
    return sigma_without_scale_um(first.tried, first.chosen, job.task.seed)


def reference_image(
    task: Task, request: Request, case: LookCase, memo: Memo = EVERY_TIME
) -> Picture:
    """Return the whole frame at the nominal state by the exact law, 8 bit.

    What the case's fidelity was chosen for is its region.
    """
    cell, scope = task.workcell, case.microscope
    seen = seen_scene(cell, world_scene(task, request.state), scope, case.focus_um)
    image = frame(
        cell, seen, scope, focus_um=case.focus_um, level=case.light.gain, memo=memo
    )
    return picture(image)
