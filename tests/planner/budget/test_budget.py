"""Budgets: every term has its source, and the advice names what helps most."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.planner.assembly.assembly import Carrier
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.alignment_residual import residual_of
from microplan.planner.budget.budget import PastMeasurement, blind_rows, fit_of
from microplan.planner.budget.control import control_of, tolerance_um
from microplan.planner.budget.insert_budget import (
    advice_of,
    insert_budget,
)
from microplan.planner.budget.insertion import Insertion, LateralResidual
from microplan.planner.budget.methods import method_of
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    combine,
    miss_probability,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store
from microplan.planner.task.task import Task
from microplan.schemas.plan.verdicts import BudgetAnalysis, Offender
from tests.planner.examples import down_the_bore, read


@pytest.fixture(scope="module")
def job() -> tuple[Task, tuple[StepState, ...]]:
    task = read(down_the_bore())
    return task, unfold(task, Report())


def step_of(states: tuple[StepState, ...], name: str) -> StepState:
    return next(s for s in states if s.step.id == name)


def seen(
    name: str, sigma_um: float, focus_um: float, magnification: float
) -> PastMeasurement:
    return PastMeasurement(
        name=name,
        step="",
        sigma_um=sigma_um,
        magnification=magnification,
        focus_um=focus_um,
        distortion_sigma_um=0.0,
        coherence_um=0.0,
    )


DOWN: Mapping[Carrier, float] = {"stage": 260.0, "robot": 0.0}
HOLE = seen("gear.bore", 0.05, 100.0, 6.9)
SHAFT = seen("shaft_plate.post", 0.08, -10.0, 6.9)


def test_the_fit_is_that_of_the_drawings(
    job: tuple[Task, tuple[StepState, ...]],
) -> None:
    task, states = job
    fit = fit_of(task, step_of(states, "insert"))
    assert isinstance(fit, OutlineFit)  # the bore has a notch
    assert fit.shape.turns_freely
    assert fit.capture_um == pytest.approx(2.9, abs=1e-6)
    assert (fit.hole_tolerance_um, fit.shaft_tolerance_um) == (0.3, 0.3)
    assert fit.taper_um == pytest.approx(0.1)  # the gear's 100 um of wall


def test_what_the_servo_cannot_see_is_listed_with_its_source(
    job: tuple[Task, tuple[StepState, ...]],
) -> None:
    cell = job[0].workcell
    rows = {row.term: row for row in blind_rows(cell, DOWN, HOLE, SHAFT)}
    assert rows["stage axis tilt over the travel"].sigma_um == pytest.approx(0.52)
    assert rows["measurement of gear.bore"].sigma_um == 0.05
    assert rows["lateral shift with focus"].sigma_um == pytest.approx(0.002 * 110)
    assert rows["parcentric jump of the zoom"].sigma_um == 0.0
    zoomed = blind_rows(cell, DOWN, HOLE, replace(SHAFT, magnification=13.8))
    assert {r.term: r.sigma_um for r in zoomed}["parcentric jump of the zoom"] == 1.0
    assert all(row.source for row in rows.values())
    unknown = [row for row in rows.values() if row.sigma_um is None]
    assert unknown  # what is not modelled says so
    assert all("not modelled" in row.source for row in unknown)


def test_the_budget_of_an_insertion_names_the_cheapest_change(
    job: tuple[Task, tuple[StepState, ...]], tmp_path: Path
) -> None:
    task, states = job
    fit = fit_of(task, step_of(states, "insert"))
    assert isinstance(fit, OutlineFit)
    residual = residual_of(task, 1.5, "stage")
    left = LateralResidual(
        residual=residual, term="left by the servo", source="workcell"
    )
    blind = blind_rows(task.workcell, DOWN, replace(HOLE, sigma_um=1.4), SHAFT)
    insertion = Insertion(fit=fit, residual=residual, blind=blind)
    memo = Memo(Store(tmp_path / "cache"))
    budget = memo.call(insert_budget, insertion, left, goal=0.95)
    assert memo.call(insert_budget, insertion, left, goal=0.95) == budget
    assert len([*(tmp_path / "cache").rglob("*.result")]) == 1
    sigma_um = combine([row.sigma_um or 0.0 for row in blind])
    miss = miss_probability(fit.inscribed, residual, sigma_um)
    # the notch gives room that a round bore has not, a ninetieth of the way round
    assert budget.success_probability == pytest.approx(1 - miss, rel=1e-3)
    assert budget.success_probability < 0.95
    assert budget.limit_um == pytest.approx(2.9, abs=1e-6)
    assert "halving 'measurement of gear.bore' (1.4 um)" in budget.advice
    fine = blind_rows(task.workcell, DOWN, HOLE, SHAFT)
    assert insert_budget(replace(insertion, blind=fine), left, goal=0.95).advice == ""


def test_the_servo_is_stable_and_gives_up_only_when_it_must(
    job: tuple[Task, tuple[StepState, ...]],
) -> None:
    task, states = job
    align, report = step_of(states, "over_shaft"), Report()
    within = tolerance_um(task, states, align, HOLE)
    assert report.found == []
    assert 0.9 <= within <= 1.5  # between easy for the stage and half the clearance
    choice = method_of(task, states, align, within, {}, report)
    control = control_of(task, align, within, choice)
    assert 0 < control.gain <= control.gain_limit / 2
    residual = residual_of(task, within, "stage")
    assert residual.sigma_um == pytest.approx(math.sqrt(2 / (2 - control.gain)))
    outside = 1 - residual.inside
    assert (
        outside ** (control.max_cycles - 1)
        <= 1e-6
        < outside ** (control.max_cycles - 2)
    )
    shaft = replace(
        SHAFT, sigma_um=1.35, sigma_without_scale_um=0.3, place_um=(270.0, 0.0)
    )
    choice = method_of(task, states, align, within, {}, report, shaft)
    control = control_of(task, align, within, choice)
    # its first look sees two landings, and what the look before did not: of the zoom,
    # .2 % of 270 um; later ones what a settled loop leaves, and a little more
    known_um = math.hypot(0.3, 0.002 * 270)
    first = Residual(sigma_um=math.hypot(math.sqrt(2), known_um), within_um=within)
    least = 1 + (1 - first.inside) / residual.inside
    assert least < control.expected_cycles < 1.15 * least


def test_a_stated_tolerance_is_kept(
    job: tuple[Task, tuple[StepState, ...]],
) -> None:
    task, states = job
    assert tolerance_um(task, states, step_of(states, "bring_between"), None) == 3.0


def test_no_advice_promises_success() -> None:
    worst = Offender(
        term="aim", size_um=1.5, slope_per_um=-0.1, halved_probability=0.99999,
        largest_um=1.0,
    )  # fmt: skip
    found = BudgetAnalysis(
        required_probability=0.95, offenders=(worst,), changes=(), allowed=(), yields=()
    )
    assert advice_of(found) == "halving 'aim' (1.5 um) would give P > 0.9999"
