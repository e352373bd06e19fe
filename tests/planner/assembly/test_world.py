"""What the simulated cell is told of the lamp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from microplan.optics.coherence.degree import Coherence
from microplan.planner.assembly.step_states import unfold
from microplan.planner.assembly.world import build_world
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import lamp_aperture
from microplan.planner.views.zooms import microscope_at

EXAMPLE = Path(__file__).parents[3] / "examples" / "gear_on_shaft" / "task.yaml"


@pytest.fixture(scope="module")
def task() -> Task:
    found = load_task(EXAMPLE, Report())
    assert found is not None
    return found


@pytest.mark.parametrize("kind", ["coaxial", "ring"])
@pytest.mark.parametrize("coherence", [0.0, 0.5, 2.0])
def test_the_cell_has_the_lamp_of_the_plan(
    task: Task, coherence: float, kind: str
) -> None:
    optics = replace(
        task.workcell.optics,
        coherence=Coherence(least=coherence, most=coherence) if coherence else None,
    )
    light = replace(task.workcell.light, kind=kind)
    cell = replace(task.workcell, optics=optics, light=light)
    other = replace(task, workcell=cell)
    scope = microscope_at(cell, 6.9)
    share = build_world(other, unfold(other, Report())[0].before).optics.lamp_share
    assert share * scope.aperture == (lamp_aperture(cell, scope) or 0.0)
