"""What declared moves leave to what they pass, against counted draws of the gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.budget import EMPTY_BUDGET
from microplan.planner.budget.probability.collision_probability import (
    narrow_gaps,
    with_collisions,
)
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.schemas.plan import Budget
from tests.planner.examples import (
    EXAMPLE,
    change,
    copy_example,
    down_the_bore,
    read,
)

STAGE_Z_UM, ROBOT_Z_UM = 1.0, 8.0  # the example's repeatabilities
GRASPED = Budget(rows=(), limit_um=12.0, success_probability=0.5, advice="")


def step_of(task: Task, name: str) -> StepState:
    return next(s for s in unfold(task, Report()) if s.step.id == name)


def lowered(folder: Path, z_um: float) -> tuple[Task, StepState]:
    """Return the step of the example that lowers the jaws beside the gear."""
    file = copy_example(folder / f"at-{z_um:g}")
    text = file.read_text(encoding="utf-8")
    now = text.split("{robot: {z_um: ", 2)[1].split("}")[0]
    change(file, f"{{robot: {{z_um: {now}}}}}]}}\n  - {{id: bring",
           f"{{robot: {{z_um: {z_um:g}}}}}]}}\n  - {{id: bring")  # fmt: skip
    task = read(file)
    return task, step_of(task, "see_fingers")


@pytest.mark.parametrize("z_um", [18.0, 25.0])
def test_the_chance_is_that_of_drawn_heights(tmp_path: Path, z_um: float) -> None:
    task, here = lowered(tmp_path, z_um)
    rng, count = np.random.default_rng(7), 2_000_000
    tools = z_um + ROBOT_Z_UM * rng.standard_normal(count)
    clear = np.mean(tools > STAGE_Z_UM * rng.standard_normal(count))
    found = with_collisions(task, here, EMPTY_BUDGET).success_probability
    assert abs(found - clear) < 4 * np.sqrt(clear * (1 - clear) / count)


def test_fingers_count_once_against_the_stage(tmp_path: Path) -> None:
    _, here = lowered(tmp_path, 25.0)
    gaps = narrow_gaps(read(EXAMPLE / "task.yaml"), here)
    onto_stage = [gap for gap in gaps if gap.still == "the stage"]
    assert [gap.gap_um for gap in onto_stage] == [25.0]


def test_the_narrowest_gap_is_told(tmp_path: Path) -> None:
    task, here = lowered(tmp_path, 25.0)
    budget = with_collisions(task, here, EMPTY_BUDGET)
    (row,) = budget.rows
    sigma_um = float(np.hypot(STAGE_Z_UM, ROBOT_Z_UM))
    assert "the stage" in row.term
    assert budget.limit_um == 25.0
    assert row.sigma_um == pytest.approx(sigma_um)
    tail = norm.sf(25.0, scale=sigma_um)
    assert 1 - budget.success_probability == pytest.approx(tail, rel=0.01)


def test_rows_of_an_action_stay_and_its_chance_falls(tmp_path: Path) -> None:
    task, here = lowered(tmp_path, 18.0)
    clear = with_collisions(task, here, EMPTY_BUDGET).success_probability
    budget = with_collisions(task, here, GRASPED)
    assert budget.rows == ()
    assert budget.limit_um == 12.0
    assert budget.success_probability == pytest.approx(0.5 * clear)


def test_wide_gaps_and_insertions_cost_nothing() -> None:
    task = read(down_the_bore())
    for name in ("lift", "insert", "retract"):
        assert with_collisions(task, step_of(task, name), EMPTY_BUDGET) == EMPTY_BUDGET
