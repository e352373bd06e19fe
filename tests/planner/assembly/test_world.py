"""What the simulated cell is told of lamp and lens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from microplan.optics.coherence.degree import Coherence
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.step_states import unfold
from microplan.planner.assembly.world import build_world
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import lamp_aperture
from microplan.planner.views.zooms import microscope_at
from microplan.schemas.codec import from_data, to_data
from microplan.schemas.files.world import World
from tests.planner.task.lens.test_wavefront import stated
from tests.planner.task.light.test_check_light import loaded

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


def test_the_cell_has_the_lens_that_the_workcell_states(tmp_path: Path) -> None:
    lens = "wavefront: [{noll: 8, waves: 0.02}, {noll: 5, waves: -.03}]"
    halo = "halo: {radius_um: 2.5, share: .06}"
    task, _ = loaded(tmp_path, stated(f"{lens}\n  {halo}"))
    assert task is not None
    optics = build_world(task, initial(task)).optics
    assert optics.wavefront == ((5, -0.03), (8, 0.02))
    assert (optics.halo_radius_um, optics.halo_share) == (2.5, 0.06)


def test_a_lens_that_is_not_stated_is_perfect_as_in_worlds_of_before(
    task: Task,
) -> None:
    world = build_world(task, initial(task))
    data = to_data(world)
    for key in ("wavefront", "halo_radius_um", "halo_share"):
        assert not data["optics"].pop(key)
    assert from_data(World, data).optics.wavefront == ()
    assert from_data(World, data).optics.halo_share == 0
