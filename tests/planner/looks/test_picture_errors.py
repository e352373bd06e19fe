"""How far real pictures lie from images: stated or usual, in looks and budgets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.world import build_world
from microplan.planner.budget.budget import PICTURES, PastMeasurement, looking_rows
from microplan.planner.looks.picture_errors import picture_rows
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import DiscrepancyShares
from microplan.schemas.plan import Repeatability, parse_plan
from tests.planner.examples import EXAMPLE, read
from tests.planner.looks.test_scenario import case_of
from tests.planner.task.light.test_check_light import loaded

LIGHT = "light:"
KNOWN = Repeatability(
    trials=64, answered=64, undetected=0, sigma_um=(0.05, 0.04), kurtosis=3.0,
    half_width_um=(0.0, 0.0), trueness_um=(0.02, 0.03), trueness_rad=None,
)  # fmt: skip
GOLDEN = parse_plan(
    (EXAMPLE.parents[1] / "tests/golden/gear_on_shaft.fast.json").read_text("utf-8")
)
SEEN = next(step.looks[0].measure for step in GOLDEN.steps if step.looks)
MEASURE = replace(SEEN, repeatability=KNOWN)


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


def test_what_is_not_stated_is_as_usual(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, {})
    assert task is not None
    usual = DiscrepancyShares(edge=0.03, flat=0.01, pixel=0.03, is_stated=False)
    assert task.workcell.discrepancy == usual


def test_what_is_stated_counts_and_what_is_left_out_is_as_usual(tmp_path: Path) -> None:
    text = "discrepancy: {edge: 0.02, pixel: 0}\nlight:"
    task, _ = loaded(tmp_path, {LIGHT: text})
    assert task is not None
    stated = DiscrepancyShares(edge=0.02, flat=0.01, pixel=0.0, is_stated=True)
    assert task.workcell.discrepancy == stated
    optics = build_world(task, initial(task)).optics
    assert (optics.discrepancy_edge, optics.discrepancy_pixel) == (0.02, 0.0)


@pytest.mark.parametrize("text", ["{edge: -0.1}", "{flat: 2}", "{rim: 0.1}", "0.03"])
def test_what_is_no_discrepancy_is_refused(tmp_path: Path, text: str) -> None:
    task, codes = loaded(tmp_path, {LIGHT: f"discrepancy: {text}\nlight:"})
    assert task is None
    assert codes


def test_a_share_of_the_target_s_own_step_is_taken(task: Task) -> None:
    """Over the shaft the bore's, past fingers that are brighter than it."""
    case = case_of(task, "over_shaft")
    assert case.discrepancy is not None
    step = case.discrepancy.pixel / task.workcell.discrepancy.pixel
    image = nominal_render(case)()
    assert 0.3 < step / float(np.ptp(image)) < 0.9
    assert case.discrepancy.size_um == pytest.approx(case.target.size_um)
    assert case.discrepancy.fine_um == pytest.approx(0.6 / 0.42, rel=0.05)


def test_nothing_at_all_is_no_discrepancy(task: Task) -> None:
    none = DiscrepancyShares(edge=0.0, flat=0.0, pixel=0.0, is_stated=True)
    cell = replace(task.workcell, discrepancy=none)
    case = case_of(replace(task, workcell=cell), "find_gear")
    assert case.discrepancy is None
    assert picture_rows(cell, case, MEASURE.repeatability) == ()


def test_the_ledger_has_the_worse_axis(task: Task) -> None:
    case = case_of(task, "find_gear")
    (row,) = picture_rows(task.workcell, case, MEASURE.repeatability)
    assert row.predicted_error == pytest.approx(30.0)  # nm
    assert row.limit == pytest.approx(1000 * case.tolerance_um)
    assert "none is stated" in row.reason


def test_a_budget_has_trueness_beside_what_repeats(task: Task) -> None:
    """Their squares add up to the look's own."""
    shaft = PastMeasurement(
        name="plate.post", step="see", sigma_um=0.05, magnification=6.9, focus_um=0.0,
        distortion_sigma_um=0.0, coherence_um=0.0, trueness_um=0.03,
    )  # fmt: skip
    hole = replace(shaft, name="gear.bore", trueness_um=0.0)
    sizes = {row.term: row.sigma_um for row in looking_rows(task.workcell, hole, shaft)}
    assert sizes[f"{PICTURES} of plate.post"] == pytest.approx(0.03)
    assert sizes[shaft.term] == pytest.approx(0.04)
    assert sizes[hole.term] == pytest.approx(0.05)
    assert f"{PICTURES} of gear.bore" not in sizes
