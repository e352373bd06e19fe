"""The laser-die example's release, by looks that are given instead of compiled."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.budget.placement import PlacementContext, placement_context
from microplan.planner.budget.placement_budget import place_budget
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.task.task import Task, TaskStep
from microplan.schemas.plan import Budget
from microplan.schemas.plan.verdicts import PlacingVerdict
from tests.planner import examples
from tests.planner.examples import ROOT

EXAMPLE = ROOT / "examples" / "laser_die" / "task.yaml"
EFFECTS = CompileContext(effort=PRESETS["fast"], max_image_error=0.005, map=map)


@cache
def read(file: Path = EXAMPLE) -> Task:
    """Return the example's task with one alignment: the closer one left out."""
    whole = both(file)
    steps = tuple(step for step in whole.steps if step.id != "closer")
    return replace(whole, steps=steps)


def both(file: Path = EXAMPLE) -> Task:
    """Return the example's task as it is."""
    return examples.read(file)


def look(
    name: str, step: str, sigma_um: float, sigma_theta_rad: float | None = None
) -> PastMeasurement:
    """Return a look at 5 x, at the middle of the field."""
    return PastMeasurement(
        name=name, step=step, sigma_um=sigma_um, sigma_theta_rad=sigma_theta_rad,
        magnification=5.0, focus_um=0.0, distortion_sigma_um=0.0, coherence_um=0.0,
    )  # fmt: skip


def memory(within_um: float = 0.4) -> MeasurementHistory:
    """Return what the example's looks leave before the release, in round numbers."""
    return MeasurementHistory(
        magnification=5.0,
        seen={
            "die": look("die.outline", "die_in_fingers", 0.02, sigma_theta_rad=2e-4),
            "submount": look("submount.mark", "over_site", 0.03, sigma_theta_rad=1e-4),
        },
        within_um=within_um,
        key="",
        before=look("submount.mark", "find_submount", 0.12),
    )


def placed(
    task: Task, known: MeasurementHistory
) -> tuple[Budget, PlacingVerdict] | None:
    """Return the budget and the verdict of the example's release: takes seconds."""
    states = unfold(task, Report())
    here = next(state for state in states if state.step.verb == "release")
    return place_budget(task, states, here, known, EFFECTS)


def put(task: Task, known: MeasurementHistory) -> PlacementContext | None:
    """Return what the example's release puts where."""
    states = unfold(task, Report())
    here = next(state for state in states if state.step.verb == "release")
    return placement_context(task, states, here, known)


def with_step(task: Task, name: str, **changes: object) -> Task:
    """Return the task with keys of one step changed."""

    def changed(step: TaskStep) -> TaskStep:
        return replace(step, **changes) if step.id == name else step  # type: ignore[arg-type]  # keys of Step

    return replace(task, steps=tuple(map(changed, task.steps)))
