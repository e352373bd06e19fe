"""Record of a compiled look in the plan, with its effects ledger."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from microplan.featuresel.look.design import random_design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.repeatability import Repeated, repeatability
from microplan.featuresel.trials.tolerance_search import usable_range
from microplan.featuresel.trials.trials import is_wrong
from microplan.planner.looks.edge_shifts.coherence_shift import (
    CoherenceShift,
    coherence_shift,
    moved_rows,
)
from microplan.planner.looks.edge_shifts.response_shift import (
    NO_SHIFT,
    ResponseShift,
    response_rows,
    response_shift,
)
from microplan.planner.looks.evaluation import (
    Arrays,
    ChosenSet,
    Evaluation,
    arrays_of,
    used_alone,
)
from microplan.planner.looks.evidence import LookFigures, evidence_of
from microplan.planner.looks.full_frames import nominal_picture
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.measures import (
    MeasuredFeature,
    depth_record,
    look_key,
    measure_record,
)
from microplan.planner.looks.model_errors.charging import charged
from microplan.planner.looks.model_errors.combined_costs import (
    of_either,
    together_cost,
)
from microplan.planner.looks.model_errors.effect_rows import with_costs
from microplan.planner.looks.picture_errors import picture_rows
from microplan.planner.looks.progress.work import DRAW
from microplan.planner.looks.records import (
    evidence,
    scene_record,
    together_record,
    view_record,
)
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.store.pictures import Picture
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import (
    middle_sigma_um,
)
from microplan.planner.views.requests import Request
from microplan.planner.views.scenes import look_scene
from microplan.planner.views.target_views import target_pose
from microplan.planner.views.targets import TargetShape
from microplan.planner.views.view_verdict import view_verdict
from microplan.planner.views.views import ViewPlan
from microplan.schemas import plan as p
from microplan.schemas.files.evidence import LookScene
from microplan.schemas.plan.views import ZoomTried

# Beyond this the target's frame is not the world's, in which a scale acts.
SMALL_RAD = 0.2
NOTHING = 0.1  # of sigma: half a percent of its square
LEAST = 3  # answers from which a standard deviation is estimated


def sigma_without_scale_um(
    tried: Evaluation, repeated: Repeated, chain: Chain, root_seed: int
) -> float:
    """Return sigma of a measured position, um, with the magnification error removed.

    A trial at the zoom ratio r shows a target at p from the axis at r p. Two looks at
    one zoom share that error, so that a budget of both has it once, by the distance
    between their positions; here it is taken off, trial by trial.

    Returns
    -------
    float
        Infinite where it is not known, at any angle or of too few answers, and where
        the scale contributes next to nothing.
    """
    case, place_um = tried.case, np.array([tried.case.x_um, tried.case.y_um])
    chosen = repeated.of(chain)
    scale_um = float(np.hypot(*place_um)) * case.promised.magnification_sigma
    if chosen.sigma_um is None or scale_um < NOTHING * chosen.sigma_um:
        return math.inf
    if case.theta_any or case.promised.pose_sigma_theta_rad > SMALL_RAD:
        return math.inf
    right = repeated.outcomes.by(chain).only(
        lambda o: o.world_um is not None and not is_wrong(case, o)
    )
    if len(right) < LEAST:
        return math.inf
    trials = random_design(case, 1 + max(o.trial for o in right), root_seed)
    zoom = np.array([trials[o.trial].magnification for o in right]) - 1
    errors_um = np.array([o.world_um for o in right]) - zoom[:, None] * place_um
    return float(errors_um.std(axis=0, ddof=1).max())


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledLook:
    """A look as the plan has it, with the files that belong to it."""

    look: p.Look
    case: LookCase
    picture: Picture
    arrays: Arrays
    distortion_sigma_um: float  # of the middle of the target, by the lens
    coherence_um: float  # how far partly coherent light may move it
    coherence_rad: float = 0.0  # and turn it
    response: ResponseShift = NO_SHIFT  # by a camera's that is not stated
    placed: LookScene
    model_cost: p.ModelCost | None = None  # at most of chain and fallback
    found: tuple[MeasuredFeature, ...] = ()  # the features measured, the target first
    sigma_without_scale_um: float = math.inf  # as in `PastMeasurement`
    figures: LookFigures | None = None  # what reports show of it


@dataclass(frozen=True, slots=True, kw_only=True)
class LookDecision:
    """The features that a look measures, with all that was evaluated before."""

    tried: Evaluation  # of its target
    found: tuple[MeasuredFeature, ...]  # the features measured, the target first
    rows: tuple[p.FeatureRow, ...]  # of all features
    effects: tuple[p.EffectRow, ...]  # the ledger
    together: ChosenSet | None  # None: the target alone
    refused: tuple[ZoomTried, ...]  # magnifications, before the one that does


def measured(
    problem: LookProblem,
    tried: Evaluation,
    shape: TargetShape | None = None,
    sigma_um: float | None = None,
    effects: Sequence[p.EffectRow] = (),
) -> MeasuredFeature:
    """Return a measured feature with the range and the bias of its chain.

    `effects` is the look's ledger; what is above its limit there is charged.

    Raises
    ------
    ValueError
        If no chain was chosen.
    """
    context = problem.context
    in_set = sigma_um is not None
    tried, charges = charged(problem, tried, effects, in_set=in_set)
    case, chosen = tried.case, tried.comparison.selection.chosen
    if chosen is None:
        raise ValueError("no chain was chosen")
    seed = problem.task.seed
    usable = context.memo.call(
        usable_range,
        case,
        tried.comparison.prepared,
        chosen.chain,
        root_seed=seed,
        draws=context.effort.range_draws,
        map=context.spread("usable range", lambda _: DRAW * context.effort.range_draws),
    )
    spare = tried.comparison.selection.fallback
    repeated = context.memo.call(
        repeatability,
        case,
        tried.comparison.prepared,
        (chosen.chain,) if spare is None else (chosen.chain, spare.chain),
        count=context.effort.random_trials,
        root_seed=seed,
        stops_um=problem.stops_um(case, [usable.focus_um]),
        map=context.spread("random trials"),
    )
    return MeasuredFeature(
        shape=shape or problem.shape,
        tried=tried,
        chosen=chosen,
        usable=usable,
        depth=context.memo.call(depth_record, case, usable)
        if context.effort.limited
        else None,
        sigma_um=sigma_um,
        repeated=repeated,
        draws=context.effort.range_draws,
        charges=charges,
    )


def compiled(problem: LookProblem, decided: LookDecision) -> CompiledLook:
    """Return the record of a look in the plan, with its files."""
    task, request, shape = problem.task, problem.request, problem.shape
    case, memo, found = decided.tried.case, problem.context.memo, decided.found
    image = reference_image(task, request, case, memo)
    spot, first = target_pose(task, request, shape), found[0]
    arrays: dict[str, Mapping[str, npt.NDArray[np.float32]]] = {}
    for each in found:
        arrays |= arrays_of(look_key(request, shape, each.shape), each.tried)
    without_scale_um = math.inf  # it is not known of several features
    if decided.together is None:
        without_scale_um = sigma_without_scale_um(
            first.tried, first.repeated, first.chosen.chain, task.seed
        )
        if first.charges.chain is not None:
            true_um = first.repeated.true(first.chosen.chain).worse_um
            without_scale_um = first.charges.chain.charged_um(without_scale_um, true_um)
    shift, response = _coherence(problem, found), _response(problem, found)
    return CompiledLook(
        look=_look(problem, decided, image, shift, response),
        case=case,
        picture=image,
        arrays=arrays,
        distortion_sigma_um=middle_sigma_um(task.workcell, case.microscope, spot),
        coherence_um=shift.um,
        coherence_rad=shift.rad,
        response=response,
        placed=look_scene(task, request.state, request.id, shape, spot),
        model_cost=_model_cost(decided),
        found=tuple(replace(each, tried=used_alone(each.tried)) for each in found),
        sigma_without_scale_um=without_scale_um,
        figures=evidence_of(task, request, found, memo),
    )


def _model_cost(decided: LookDecision) -> p.ModelCost | None:
    """Return what images' errors cost the target's place, by chain or fallback."""
    if decided.together is None:
        charges = decided.found[0].charges
        return of_either(charges.chain, charges.fallback)
    costs = [each.charges.chain for each in decided.found]
    places = [each.shape.center_um for each in decided.found]
    apart_um = max(math.dist(a, b) for a in places for b in places)
    return together_cost(costs, apart_um)


def _coherence(
    problem: LookProblem, found: Sequence[MeasuredFeature]
) -> CoherenceShift:
    """Return how far coherence may move the answer: the most of all features."""
    context, coherence = problem.context, problem.task.workcell.optics.coherence
    shifts = [
        context.memo.call(
            coherence_shift,
            each.tried.case,
            each.tried.comparison.prepared,
            each.chosen.chain,
            coherence,
            root_seed=problem.task.seed,
            map=context.map,
        )
        for each in found
    ]
    return max(shifts, key=lambda shift: (shift.um, shift.rad))


def _response(problem: LookProblem, found: Sequence[MeasuredFeature]) -> ResponseShift:
    """Return how far an unstated response may move the answer: the most of all."""
    context = problem.context
    if problem.task.workcell.camera.is_response_stated:
        return NO_SHIFT
    shifts = [
        context.memo.call(
            response_shift,
            each.tried.case,
            each.tried.comparison.prepared,
            each.chosen.chain,
            root_seed=problem.task.seed,
            map=context.map,
        )
        for each in found
    ]
    return max(shifts, key=lambda shift: (shift.um, shift.rad))


def _look(
    problem: LookProblem,
    decided: LookDecision,
    image: Picture,
    shift: CoherenceShift,
    response: ResponseShift,
) -> p.Look:
    """Return the look as `plan.json` has it."""
    task, request = problem.task, problem.request
    shape, found = problem.shape, decided.found
    case = decided.tried.case
    first, *others = [measure_record(request, shape, each) for each in found]
    usable = {each.shape.name: each.usable.focus_um for each in found}
    view = view_record(task, request, case, list(usable.values()))
    path, chosen = f"images/{request.id}.png", decided.together
    together = together_record(chosen, _model_cost(decided)) if chosen else None
    known = (together or first).repeatability
    return p.Look(
        id=request.id,
        target=shape.name,
        view=view,
        scene=scene_record(
            task,
            request,
            case.microscope,
            case.static + case.moving,
            shape,
            path,
            image,
        ),
        effects=(
            *with_costs(decided.effects, found[0].charges),
            *moved_rows(task.workcell.optics.coherence, case, shift),
            *response_rows(
                case, response, is_stated=task.workcell.camera.is_response_stated
            ),
            *picture_rows(task.workcell, case, known),
        ),
        measure=first,
        evidence=evidence(
            found[0].tried, found[0].chosen, decided.rows, case.tolerance_um
        ),
        others=tuple(others),
        together=together,
        verdict=view_verdict(task, request, view, usable, decided.refused),
    )


def reference_image(
    task: Task, request: Request, case: LookCase, memo: Memo = EVERY_TIME
) -> Picture:
    """Return the whole frame at the nominal state by the exact model, 8 bit.

    As the camera counts it, its response included.
    What the case's fidelity was chosen for is its region.
    """
    view = ViewPlan(
        microscope=case.microscope,
        focus_um=case.focus_um,
        light=case.light.gain,
        region=case.window,
    )
    return nominal_picture(task, request, view, memo)
