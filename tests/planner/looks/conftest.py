"""What tests of looks share: a look before anything is tried."""

from __future__ import annotations

import pytest

from microplan.featuresel.selection.evaluate import RoutineComparison
from microplan.featuresel.trials.outcomes import Outcomes
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from tests.planner.placed import both

CHAIN = ("ncc",)


@pytest.fixture(scope="module")
def tried() -> Evaluation:
    """Return the look at the die in the fingers with nothing tried yet."""
    task = both()
    states = unfold(task, Report())
    index = next(k for k, s in enumerate(states) if s.step.id == "die_in_fingers")
    (request,) = requests(task, states, index, None)
    case, fidelity = build_case(
        task, request, views(task, request, 5.0, Report())[0], 1
    )
    nothing = PreparedRoutines(chains=(CHAIN,), artifacts={})
    comparison = RoutineComparison(
        prepared=nothing, outcomes=Outcomes.of(), scores=(), limit_um=None,
        selection=None,  # type: ignore[arg-type]  # nothing was selected
        visible=None,
    )  # fmt: skip
    return Evaluation(case=case, fidelity=fidelity, comparison=comparison)
