"""One look compiled: trials, choice, and what the plan says of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from featuresel.candidates import chains
from featuresel.case import LookCase, scene
from featuresel.perturb import design
from featuresel.routines import Artifact, Failure, load
from featuresel.score import Score, score
from featuresel.select import Selection, select
from featuresel.trials import Map, Outcome, Prepared, is_wrong, prepare, run
from featuresel.usable import UsableRange, usable_range
from optics.fidelity import Fidelity
from optics.jacobian import point_jacobian, to_px
from optics.layer_error import TREATMENTS, LayerChoice, LayerRefusal, layer_error
from optics.ledger import Imaged, ledger
from optics.lensing import lens_scene
from planner.cases import build_case
from planner.diagnostics import Report
from planner.frames import frame, seen_scene
from planner.inputs.task import Task
from planner.lens import (
    NM_PER_UM,
    lamp_aperture,
    lens_rows,
    middle_offset_um,
    middle_sigma_um,
)
from planner.model.assembly import height_sigma_um
from planner.model.requests import Request
from planner.model.scenes import shade_of, world_scene
from planner.model.sightings import needed_shape, spot_of, views
from planner.model.targets import Shape
from planner.model.views import ViewPlan, focus_stops
from planner.pictures import Picture, picture, picture_sha256
from planner.presets import Effort
from schemas import plan as p
from schemas.pose import Pose

Arrays = Mapping[str, Mapping[str, npt.NDArray[np.float32]]]

# Gates lie outside what every accepted trial showed, by these margins.
SCORE_MARGIN = 0.8
SHIFT_MARGIN = 1.5


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Benchmark:
    """A case, what was tried on it, and what came of it."""

    case: LookCase
    fidelity: Fidelity
    prepared: Prepared
    outcomes: tuple[Outcome, ...]
    scores: tuple[Score, ...]
    selection: Selection


def _benchmark(
    task: Task, case: LookCase, fidelity: Fidelity, effects: Effects
) -> _Benchmark:
    """Return the choice among all chains, with the trials behind it."""
    candidates = chains(case.target)
    prepared = prepare(case, candidates)
    trials = design(case, effects.effort.trials, task.seed)
    outcomes = run(case, prepared, trials, effects.map)
    scores = score(case, candidates, outcomes)
    selection = select(
        scores,
        tolerance_um=case.tolerance_um,
        tolerance_theta_rad=case.tolerance_theta_rad,
    )
    return _Benchmark(
        case=case,
        fidelity=fidelity,
        prepared=prepared,
        outcomes=outcomes,
        scores=scores,
        selection=selection,
    )


def _finish(
    task: Task, request: Request, tried: _Benchmark, chosen: Score, effects: Effects
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
    image = _reference_image(task, request, case)
    name = f"images/{request.id}.png"
    return CompiledLook(
        look=p.Look(
            id=request.id,
            target=shape.name,
            view=_view(task, request, case, usable.focus_um),
            scene=_scene_record(task, request, case, shape, name, image),
            effects=_effects(task, request, tried),
            measure=_measure(request, shape, tried, chosen, usable),
            evidence=_evidence(tried, chosen),
        ),
        case=case,
        picture=image,
        arrays=_arrays(request.id, tried),
        distortion_sigma_um=middle_sigma_um(
            task.workcell, case.microscope, spot_of(task, request, shape)
        ),
        coherence_um=middle_offset_um(task, request.state, shape, case.microscope),
    )


def _view(
    task: Task, request: Request, case: LookCase, usable_um: tuple[float, float]
) -> p.View:
    """Return how the microscope is set."""
    focus = task.workcell.optics.focus
    owner = needed_shape(task, request).owner
    spread = math.hypot(
        height_sigma_um(task, request.state, owner), focus.repeatability_um
    )
    limits = (focus.min_um, focus.max_um)
    return p.View(
        magnification=case.microscope.magnification,
        focus_um=case.focus_um,
        focus_stops_um=focus_stops(case.focus_um, usable_um, spread, limits),
        light=case.light.gain,
        field_um=case.microscope.field_um,
        um_per_px=case.microscope.um_per_px,
    )


def _evidence(tried: _Benchmark, chosen: Score) -> p.Evidence:
    """Return every chain's score with the reason for or against it."""
    reasons = dict(tried.selection.reasons)
    return p.Evidence(
        tolerance_um=tried.case.tolerance_um,
        chosen=_score(chosen, reasons[chosen.chain]),
        others=tuple(
            _score(other, reasons[other.chain])
            for other in tried.scores
            if other.chain != chosen.chain
        ),
    )


def _reference_image(task: Task, request: Request, case: LookCase) -> Picture:
    """Return the whole frame at the nominal state by the exact law, 8 bit.

    What the case's fidelity was chosen for is its region.
    """
    cell, scope = task.workcell, case.microscope
    seen = seen_scene(cell, world_scene(task, request.state), scope, case.focus_um)
    image = frame(cell, seen, scope, focus_um=case.focus_um, level=case.light.gain)
    return picture(image)


def _scene_record(
    task: Task,
    request: Request,
    case: LookCase,
    shape: Shape,
    name: str,
    image: Picture,
) -> p.SceneRecord:
    """Return what is in view, and what is hidden or shaded."""
    spot = spot_of(task, request, shape)
    scope = case.microscope
    layers = sorted(case.static + case.moving, key=lambda la: (la.z_um, la.name))
    return p.SceneRecord(
        layers=tuple(
            p.LayerRecord(name=la.name, z_um=la.z_um, reflectance=la.reflectance)
            for la in layers
        ),
        shades=shade_of(
            task, request.state, shape, spot, scope.aperture, scope.medium_index
        ),
        image=name,
        image_sha256=picture_sha256(image),
    )


def _effects(
    task: Task, request: Request, tried: _Benchmark
) -> tuple[p.EffectRow, ...]:
    """Return the effects ledger of a look."""
    case, shape = tried.case, needed_shape(task, request)
    spot = spot_of(task, request, shape)
    rows = ledger(
        _imaged(task, tried),
        lens_rows(task, request.state, shape, spot, case.microscope),
        shift_limit_nm=NM_PER_UM * case.tolerance_um,
    )
    return tuple(
        p.EffectRow(
            effect=row.effect,
            level=row.level,
            predicted_error=row.predicted_error,
            limit=row.limit,
            unit=row.unit,
            reason=row.reason,
        )
        for row in rows
    )


def _imaged(task: Task, tried: _Benchmark) -> Imaged:
    """Return the nominal image of a look, and how it is computed."""
    case, limit = tried.case, tried.fidelity.limit
    shown = lens_scene(
        scene(case, 0.0, 0.0, 0.0), case.microscope, case.lens, case.focus_um
    )
    errors = {
        treatment: layer_error(
            shown,
            case.microscope,
            focus_um=case.focus_um,
            treatment=treatment,
            window=case.window,
        )
        for treatment in TREATMENTS
    }
    layering = LayerChoice(
        treatment=case.treatment,
        predicted_error=errors[case.treatment],
        limit=limit,
        refused=tuple(
            LayerRefusal(treatment=name, predicted_error=error)
            for name, error in errors.items()
            if name != case.treatment and errors[case.treatment] > limit
        ),
    )
    return Imaged(
        scene=shown,
        microscope=case.microscope,
        focus_um=case.focus_um,
        window=case.window,
        fidelity=tried.fidelity,
        layering=layering,
        coherence=task.workcell.optics.coherence,
        lamp_aperture=lamp_aperture(task.workcell, case.microscope),
        is_shaded=case.lamp_aperture is not None,
    )


def _used(tried: _Benchmark) -> tuple[str, ...]:
    """Return the routines of chain and fallback, each once."""
    selection = tried.selection
    spare = selection.fallback.chain if selection.fallback else ()
    chosen = selection.chosen.chain if selection.chosen else ()
    return tuple(dict.fromkeys(chosen + spare))


def _artifact(tried: _Benchmark, name: str) -> Artifact:
    """Return what a routine prepared; one that failed to is never selected."""
    found = tried.prepared.artifacts[name]
    if isinstance(found, Failure):
        raise ValueError(f"{name} was selected but not prepared: {found.message}")
    return found


def _arrays(look: str, tried: _Benchmark) -> Arrays:
    """Return the arrays of the routines used, by their path in the plan folder."""
    return {
        _array_path(look, name): _artifact(tried, name).arrays
        for name in _used(tried)
        if _artifact(tried, name).arrays
    }


def _array_path(look: str, name: str) -> str:
    return f"artifacts/{look}.{name}.npz"


def _use(look: str, tried: _Benchmark, name: str) -> p.RoutineUse:
    """Return one routine of a chain as the plan has it."""
    artifact = _artifact(tried, name)
    return p.RoutineUse(
        id=name,
        version=load(name).VERSION,
        parameters=artifact.parameters,
        arrays=_array_path(look, name) if artifact.arrays else None,
    )


def _measure(
    request: Request,
    shape: Shape,
    tried: _Benchmark,
    chosen: Score,
    usable: UsableRange,
) -> p.Measure:
    """Return how the look measures, with what the trials promise."""
    case, spare = tried.case, tried.selection.fallback
    return p.Measure(
        chain=tuple(_use(request.id, tried, name) for name in chosen.chain),
        fallback=tuple(
            _use(request.id, tried, name) for name in (spare.chain if spare else ())
        ),
        region=_region(case),
        reference=_reference(case),
        bias_um=chosen.bias_um or (0.0, 0.0),
        jacobian_px_per_um=_jacobian(case),
        sigma_xy_um=chosen.sigma_um or 0.0,
        sigma_theta_rad=chosen.sigma_theta_rad,
        limit_xy_um=None,
        gates=_gates(tried, chosen),
        capture_um=case.spread.search_um,
        symmetry=shape.symmetry,
        symmetry_broken_by=shape.symmetry_broken_by
        if case.tolerance_theta_rad is not None
        else "",
        usable_focus_um=usable.focus_um,
        usable_magnification=usable.magnification,
        fallback_bias_um=(spare.bias_um if spare else None) or (0.0, 0.0),
        fallback_min_score=0.0 if spare is None else _min_score(tried, spare),
    )


def _region(case: LookCase) -> p.Region:
    """Return the part of the frame that the routines see."""
    window = case.window
    return p.Region(
        row=window.row, column=window.column, rows=window.rows, columns=window.columns
    )


def _reference(case: LookCase) -> p.Reference:
    """Return where the target should be."""
    return p.Reference(
        column=case.target.column,
        row=case.target.row,
        pose=Pose(x_um=case.x_um, y_um=case.y_um, theta_rad=case.theta_rad),
        z_um=case.focus_um,
    )


def _gates(tried: _Benchmark, chosen: Score) -> p.Gates:
    """Return what a measurement must meet: what every good trial met, and a margin."""
    return p.Gates(
        min_score=_min_score(tried, chosen),
        max_shift_um=SHIFT_MARGIN * tried.case.spread.search_um,
        max_turn_rad=None,
    )


def _min_score(tried: _Benchmark, chain: Score) -> float:
    """Return the least score a chain may have, a margin below its good trials."""
    scores = [
        outcome.score
        for outcome in tried.outcomes
        if outcome.chain == chain.chain
        and outcome.score is not None
        and not is_wrong(tried.case, outcome)
    ]
    return SCORE_MARGIN * min(scores, default=0.0)


def _jacobian(case: LookCase) -> tuple[tuple[float, ...], ...]:
    """Return d(u, v) / d(x, y, theta, zoom) at the nominal place.

    Columns as in `optics.jacobian.point_jacobian`; the turn is about the target.
    """
    here_um = (case.x_um, case.y_um)
    point = to_px(np.array([here_um]), case.microscope)
    matrix = point_jacobian(point, case.microscope, axis_um=here_um)
    return tuple(tuple(float(v) for v in row) for row in matrix)


def _score(found: Score, reason: str) -> p.Score:
    """Return a chain's score as the plan has it."""
    return p.Score(
        chain=found.chain,
        trials=found.trials,
        success=found.success,
        success_lower=found.success_lower,
        silent=found.silent,
        silent_upper=found.silent_upper,
        bias_um=found.bias_um,
        sigma_um=found.sigma_um,
        worst_um=found.worst_um,
        sigma_theta_rad=found.sigma_theta_rad,
        cost=found.cost,
        reason=reason,
    )


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
