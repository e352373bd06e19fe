"""The example's looks with the likelihood chain, whatever chains the plan chose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from benchmarks.example import TASK
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact
from microplan.featuresel.routines.registry import load
from microplan.featuresel.trials.chains import Chain, chains
from microplan.featuresel.trials.trials import prepare
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.target_views import views
from microplan.schemas.plan import Gates, Look, Plan, RoutineUse

FINE = "likelihood"
MAX_IMAGE_ERROR = 0.002  # the example's own


@dataclass(frozen=True, slots=True, kw_only=True)
class Fine:
    """A look with the likelihood chain in the plan's place, and what it needs."""

    look: Look
    chain: Chain
    case: LookCase
    artifacts: Mapping[str, Artifact]


def fine_looks(plan: Plan, only: str = "") -> dict[str, Fine]:
    """Return the looks of the example's plan that the likelihood chain can make, by id.

    At the plan's own magnification, through the region that the compiler would cut.
    All of them, or `only` one.
    """
    task = load_task(TASK, Report())
    if task is None:
        raise RuntimeError("the example cannot be read")
    states = unfold(task, Report())
    looks = {look.id: look for step in plan.steps for look in step.looks}
    found = {}
    for index in range(len(states)):
        for request in requests(task, states, index, 1.0):
            if only not in ("", request.id):
                continue
            fine = _fine(task, request, looks[request.id])
            if fine is not None:
                found[request.id] = fine
    return found


def _fine(task: Task, request: Request, look: Look) -> Fine | None:
    """Return one look with its likelihood chain, None if there is none for it."""
    zoom = look.view.magnification
    settings = views(task, request, zoom, Report())
    view = next(
        v for v in settings if abs(v.microscope.magnification / zoom - 1) < 1e-5
    )
    case, _ = build_case(task, request, view, MAX_IMAGE_ERROR)
    ending = [chain for chain in chains(case.target) if chain[-1] == FINE]
    for chain in ending:
        made = prepare(case, (chain,)).artifacts
        ready = {n: a for n, a in made.items() if isinstance(a, Artifact)}
        if len(ready) == len(made):
            changed = _with_chain(look, case, chain, ready)
            return Fine(look=changed, chain=chain, case=case, artifacts=ready)
    return None


def _with_chain(
    look: Look, case: LookCase, chain: Chain, ready: Mapping[str, Artifact]
) -> Look:
    """Return a look that measures by another chain: nothing is taken off its answer."""
    uses = tuple(
        RoutineUse(
            id=name,
            version=load(name).version,
            parameters=ready[name].parameters,
            arrays=None,
        )
        for name in chain
    )
    window, target = case.window, case.target
    region = replace(
        look.measure.region,
        row=window.row,
        column=window.column,
        rows=window.rows,
        columns=window.columns,
    )
    reference = replace(look.measure.reference, column=target.column, row=target.row)
    gates = look.measure.gates
    measure = replace(
        look.measure,
        chain=uses,
        fallback=(),
        bias_um=(0.0, 0.0),
        region=region,
        reference=reference,
        gates=Gates(min_score=0.0, max_shift_um=gates.max_shift_um, max_turn_rad=None),
    )
    return replace(look, measure=measure)
