"""A task's look made ready to measure pictures: case, chain, gates, accuracy."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from microplan.featuresel.limits.crlb import limit_um
from microplan.featuresel.look.design import design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.routines.registry import REGISTRY
from microplan.featuresel.selection.evaluate import RoutineComparison, compare_routines
from microplan.featuresel.selection.select import Selection
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.repeatability import Repeated, repeatability
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trial_cache import Looks
from microplan.featuresel.trials.trials import PreparedRoutines, prepare, run
from microplan.optics.render.fidelity import Fidelity
from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.control import tolerance_um
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.measures import acceptance_gates
from microplan.planner.looks.model_errors.model_cost import AcceptedRange
from microplan.planner.looks.scenario import build_case
from microplan.planner.measure.lens_trueness import lens_trueness_um
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.memo import Memo
from microplan.planner.task.presets import PRESETS, Effort, Preset
from microplan.planner.task.task import Task
from microplan.planner.views.coarse import first_views
from microplan.planner.views.requests import Request, requests
from microplan.schemas import plan as p

CODE = "MP902"


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureLookCall:
    """Which look is meant; None leaves it to the compiler's choice."""

    step: str
    chain: Chain | None = None
    magnification: float | None = None
    focus_um: float | None = None
    preset: Preset | None = None
    # no later step uses it: the angle only if it can be known, and of the chains that
    # are good enough the most accurate, not the cheapest
    alone: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureLook:
    """All that measuring a picture takes, and how accurate it is."""

    case: LookCase
    stages: tuple[tuple[str, Artifact], ...]  # of the chain
    gates: p.Gates
    bias_um: tuple[float, float]  # mean error in trials, the target's frame
    # what real pictures and lenses move answers by, the worse axis, one sigma; None:
    # not known
    trueness_um: float | None
    limit_um: float | None  # Cramer-Rao, the worse axis; None: there is none

    @property
    def chain(self) -> Chain:
        """Return the names of the chain's routines."""
        return tuple(name for name, _ in self.stages)


def check_chain(chain: Chain | None) -> None:
    """Raise a CallError, MP902, if a chain names a routine that there is not."""
    unknown = [name for name in chain or () if name not in REGISTRY]
    if unknown:
        message = f"no routine {unknown[0]!r}; known: {', '.join(sorted(REGISTRY))}"
        raise CallError(CODE, message)


def picture_look(
    task: Task,
    call: PictureLookCall,
    report: Report,
    memo: Memo,
    progress: Callable[[str], None] = lambda _: None,
) -> PictureLook | None:
    """Return a step's look made ready, None if it cannot be made: see `report`.

    Raises
    ------
    CallError
        MP404 if the step or the magnification does not exist, MP902 if a routine does
        not.
    """
    check_chain(call.chain)
    request = _request(task, call.step)
    tried = _tried(task, request, call, report, memo, progress)
    if tried is None:
        return None
    chosen = tried.comparison.selection.chosen
    if chosen is None and call.alone and request.wants_angle:
        request = replace(request, wants_angle=False)
        # the same view again: its findings are known
        tried = _tried(task, request, call, Report(), memo, progress) or tried
        chosen = tried.comparison.selection.chosen
    if chosen is None:
        case = tried.case
        message = (
            f"look {request.id!r}: nothing measures {case.target.name} well enough"
        )
        message += f" at {case.microscope.magnification:.4g} x"
        advice = tried.comparison.selection.advice
        report.refuse(CODE, request.where, message, advice)
        return None
    pareto = tried.comparison.selection.pareto
    if call.alone and pareto:
        chosen = pareto[-1]
    repeated = memo.call(
        repeatability,
        tried.case,
        tried.comparison.prepared,
        (chosen.chain,),
        count=PRESETS[_preset(task, call)].random_trials,
        root_seed=task.seed,
    )
    return _ready(tried, chosen, repeated, _trueness_um(task, tried, repeated, memo))


def _trueness_um(
    task: Task, tried: Evaluation, repeated: Repeated, memo: Memo
) -> float | None:
    """Return how far discrepancies, wavefront and halo move a chain's answers."""
    (found,) = repeated.scores
    names, made = set(found.chain), tried.comparison.prepared.artifacts
    alone = PreparedRoutines(
        chains=(found.chain,), artifacts={name: made[name] for name in sorted(names)}
    )
    lens_um = memo.call(
        lens_trueness_um, tried.case, alone, task.workcell.optics, task.seed
    )
    pictures_um = max(repeated.true(found.chain).um or (), default=None)
    if lens_um is None or pictures_um is None:
        return None
    return math.hypot(lens_um, pictures_um)


def _preset(task: Task, call: PictureLookCall) -> Preset:
    return call.preset or task.optimise.prefer


def _tried(
    task: Task,
    request: Request,
    call: PictureLookCall,
    report: Report,
    memo: Memo,
    progress: Callable[[str], None],
) -> Evaluation | None:
    """Return a look with its chains compared, None if it has no view: see `report`."""
    built = _case(task, request, call, report, memo)
    if built is None:
        return None
    case, fidelity = built
    progress(f"trying routines on images of {case.target.name} ...")
    effort = PRESETS[_preset(task, call)]
    compared = _compared(task, case, call.chain, effort, memo)
    return Evaluation(case=case, fidelity=fidelity, comparison=compared)


def _ready(
    tried: Evaluation,
    chosen: ChainScore,
    repeated: Repeated,
    trueness_um: float | None,
) -> PictureLook:
    """Return what measures pictures by a chain, with its accuracy in trials."""
    chain, artifacts = chosen.chain, tried.comparison.prepared.artifacts
    made = [(name, artifacts[name]) for name in chain]
    return PictureLook(
        case=tried.case,
        stages=tuple((name, a) for name, a in made if not isinstance(a, Failure)),
        gates=acceptance_gates(tried, chosen, AcceptedRange()),
        bias_um=repeated.of(chain).bias_um or (0.0, 0.0),
        trueness_um=trueness_um,
        limit_um=tried.comparison.limit_um,
    )


def _request(task: Task, step: str) -> Request:
    """Return the look that a step asks for; MP404 if there is none."""
    # what else is wrong with the assembly hinders no look at a picture
    states = unfold(task, Report())
    for index, here in enumerate(states):
        if here.step.id == step:
            within = None
            if here.step.verb == "align":
                within = tolerance_um(task, states, here, None)
            for request in requests(task, states, index, within):
                return request
            raise CallError("MP404", f"step {step!r} has no look")
    known = ", ".join(state.step.id for state in states)
    raise CallError("MP404", f"no step {step!r}; known: {known}")


def _case(
    task: Task, request: Request, call: PictureLookCall, report: Report, memo: Memo
) -> tuple[LookCase, Fidelity] | None:
    """Return the look's case at the first magnification or the one asked for.

    None, and a finding, if it has no view.
    """
    low, _ = task.workcell.optics.magnification
    limit = task.optimise.image_error(call.preset)
    request, settings = first_views(task, request, low, report)
    if not settings:
        return None
    if call.focus_um is not None and not math.isfinite(call.focus_um):
        raise CallError("MP404", f"focus must be finite, got {call.focus_um}")
    for view in settings:
        zoom = view.microscope.magnification
        if call.magnification is None or math.isclose(zoom, call.magnification):
            if call.focus_um is not None:
                view = replace(view, focus_um=call.focus_um)  # noqa: PLW2901
            return build_case(task, request, view, limit, memo)
    tried = ", ".join(f"{view.microscope.magnification:.6g}" for view in settings)
    raise CallError("MP404", f"{request.id} is tried at {tried} x only")


def _compared(
    task: Task, case: LookCase, chain: Chain | None, effort: Effort, memo: Memo
) -> RoutineComparison:
    """Return the race of all chains, or the trials of the one asked for."""
    if chain is not None:
        return memo.call(
            tried_alone, case, chain, trials=effort.trials, root_seed=task.seed
        )
    return memo.call(
        compare_routines,
        case,
        root_seed=task.seed,
        most=effort.trials,
        thorough=effort.thorough,
        to_the_end=False,
        limited=True,
        map=map,
        looks=Looks(),
        rejected=None,
    )


def tried_alone(
    case: LookCase, chain: Chain, *, trials: int, root_seed: int
) -> RoutineComparison:
    """Return the trials of one chain, chosen if it is ever right."""
    prepared = prepare(case, (chain,))
    outcomes = run(case, prepared, design(case, trials, root_seed))
    (found,) = score(case, prepared, outcomes)
    refused = [a for a in prepared.artifacts.values() if isinstance(a, Failure)]
    is_right = found.success > 0 and not refused
    return RoutineComparison(
        prepared=prepared,
        outcomes=outcomes,
        scores=(found,),
        selection=Selection(
            chosen=found if is_right else None,
            fallback=None,
            reasons=(),
            advice="" if is_right else _advice(found, refused),
        ),
        limit_um=limit_um(case) if is_right else None,
        visible=None,
    )


def _advice(found: ChainScore, refused: Sequence[Failure]) -> str:
    """Return why a chain is never right, and what to do."""
    why = f"wrong in {found.silent} of {found.trials} trials"
    if refused:
        why = refused[0].message
    elif found.failures:
        code, count = Counter(dict(found.failures)).most_common(1)[0]
        why = f"{code} in {count} of {found.trials} trials"
    words = ", ".join(found.chain)
    return f"{words}: {why}; leave out --chain to have the routines compared"
