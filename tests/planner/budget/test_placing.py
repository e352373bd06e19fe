"""Putting a part down: its budget against closed forms, draws and changed tasks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.insert_budget import share_of_goal
from microplan.planner.budget.insertion import Insertion, LateralResidual
from microplan.planner.budget.placement import PlacementContext
from microplan.planner.budget.placement_budget import (
    angle_error,
    place_budget,
    placement_errors,
    placement_residual,
)
from microplan.planner.budget.placing import Placement, placing_budget, within
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Move, Reading, Task
from microplan.schemas.plan import Budget, BudgetRow
from microplan.schemas.plan.verdicts import PlacingVerdict, TurnRow
from tests.planner import examples
from tests.planner.placed import (
    EFFECTS,
    both,
    look,
    memory,
    placed,
    put,
    read,
    with_step,
)

SAMPLES = 1_000_000
STILL = AngleError(left_rad=0.0, cut_rad=math.inf, rows=())


@pytest.fixture(scope="module")
def task() -> Task:
    return read()


def row(sigma_um: float, along_rad: float | None = None) -> BudgetRow:
    term = f"{sigma_um} {along_rad}"
    return BudgetRow(term=term, sigma_um=sigma_um, source="test", along_rad=along_rad)


def placement(**more: object) -> Placement:
    plain = Placement(
        target="die", on="submount.mark", verified_by="check", within_um=0.3,
        within_rad=None, far_um=250.0, stick_probability=0.0,
    )  # fmt: skip
    return replace(plain, **more)  # type: ignore[arg-type]  # keys of Placement


def left(sigma_um: float, within_um: float = math.inf) -> LateralResidual:
    found = Residual(sigma_um=sigma_um, within_um=within_um)
    return LateralResidual(residual=found, term="servo", source="test")


def test_alike_in_all_directions_it_is_rayleighs_law() -> None:
    sigma = math.hypot(0.08, 0.05)
    job = Insertion(fit=within(0.3), residual=left(0.08).residual, blind=(row(0.05),))
    some = placement(stick_probability=0.1)
    budget, verdict = placing_budget(some, job, left(0.08), STILL, goal=0.95)
    exact = -math.expm1(-((0.3 / sigma) ** 2) / 2)
    assert verdict.place_probability == pytest.approx(exact, rel=1e-9)
    assert budget.success_probability == pytest.approx(0.9 * exact, rel=1e-9)
    assert budget.limit_um == 0.3
    for share, found in ((0.5, verdict.half_um), (0.95, verdict.most_um)):
        radius = sigma * math.sqrt(-2 * math.log(1 - share))
        assert found == pytest.approx(radius, rel=2e-3)  # found to a thousandth
    assert budget.analysis is not None
    first, *_ = budget.analysis.yields
    for point in first.points:
        chance = -math.expm1(-((point.value_um / sigma) ** 2) / 2)
        assert point.success_probability == pytest.approx(chance, rel=1e-9)


def test_an_alignment_that_ends_early_is_a_mixture_of_draws() -> None:
    rng = np.random.default_rng(3)
    early, late = Residual(sigma_um=0.14, within_um=0.3), left(0.07, 0.3).residual
    job = Insertion(
        fit=within(0.25), residual=late, early=(0.3, early),
        blind=(row(0.03), row(0.05, 0.7)),
    )  # fmt: skip
    first = rng.random(SAMPLES) < 0.3
    sigma = np.where(first, early.sigma_um, late.sigma_um)
    error = np.zeros((SAMPLES, 2))
    outside = np.ones(SAMPLES, dtype=bool)
    while outside.any():
        draws = rng.standard_normal((int(outside.sum()), 2))
        error[outside] = draws * sigma[outside, None]
        outside = np.hypot(*error.T) >= 0.3
    left_um = math.sqrt(float((error**2).mean()))
    assert job.left_um == pytest.approx(left_um, rel=5 / math.sqrt(SAMPLES))
    error += rng.normal(0.0, 0.03, error.shape)
    error += rng.normal(0.0, 0.05, (SAMPLES, 1)) * [math.cos(0.7), math.sin(0.7)]
    missed = int((np.hypot(*error.T) >= 0.25).sum())
    assert 0.01 < job.miss < 0.2
    assert binom.cdf(missed, SAMPLES, job.miss) > 1e-4
    assert binom.sf(missed - 1, SAMPLES, job.miss) > 1e-4


def test_an_angle_that_must_be_kept_counts() -> None:
    job = Insertion(fit=within(0.3), residual=left(0.08).residual, blind=())
    rows = (TurnRow(term="angle", sigma_rad=1e-3, source="test"),)
    turning = replace(STILL, rows=rows)
    free, _ = placing_budget(placement(), job, left(0.08), turning)
    kept, verdict = placing_budget(placement(within_rad=1e-3), job, left(0.08), turning)
    one_sigma = math.erf(math.sqrt(0.5))
    assert verdict.turn_probability == pytest.approx(one_sigma)
    assert kept.success_probability == pytest.approx(
        one_sigma * free.success_probability
    )
    assert verdict.far_sigma_um == pytest.approx(0.25, rel=1e-6)


def test_a_placement_that_falls_short_says_what_would_do() -> None:
    job = Insertion(fit=within(0.3), residual=left(0.14).residual, blind=(row(0.03),))
    budget, _ = placing_budget(placement(), job, left(0.14), STILL, goal=0.97)
    assert budget.analysis is not None
    said = [change.what for change in budget.analysis.changes]
    assert any(what.startswith("bring 'servo' from 0.14") for what in said)
    # r = S sqrt(-2 ln .03) = .3792 um, .0792 more
    assert any(what.startswith("allow 0.079") for what in said)
    assert not any("hole" in what for what in said)
    assert budget.advice


Found = tuple[Budget, PlacingVerdict]


@pytest.fixture(scope="module")
def found(task: Task) -> Found:
    """Return budget and verdict of the example's release."""
    whole = placed(task, memory())
    assert whole is not None
    return whole


def putting(task: Task) -> PlacementContext:
    some = put(task, memory())
    assert some is not None
    return some


def test_the_example_has_every_term_with_its_source(found: Found) -> None:
    budget, verdict = found
    rows = {row.term: row for row in budget.rows}
    assert all(row.source for row in budget.rows)
    assert rows["measurement of die.outline"].sigma_um == 0.02
    assert rows["measurement of submount.mark"].sigma_um == 0.03
    assert rows["stage axis tilt over the travel"].sigma_um == pytest.approx(2e-4 * 8)
    # .01 um a minute over 8 um at 500 um/s and .1 s to settle
    drift = 0.01 * (8 / 500 + 0.1) / 60
    assert rows["drift while placing"].sigma_um == pytest.approx(drift)
    lever = rows["angle of die.outline over the way to what is placed"]
    assert lever.sigma_um == pytest.approx(2e-4 * 145)
    assert abs(math.sin(lever.along_rad or 0.0)) < 1e-9  # the way runs along y
    assert not any("submount.mark over" in term for term in rows)  # no way at all
    assert verdict.far_um == pytest.approx(math.hypot(125, 220))
    assert [row.term for row in verdict.turn_rows] == [
        "angle of die.outline", "angle of submount.mark",
    ]  # fmt: skip
    assert 0.9 < budget.success_probability < 1


def test_the_first_look_may_end_the_alignment(task: Task) -> None:
    """With nothing to turn it mostly does; then the look before decides."""
    straight = putting(with_step(task, "over_site", tolerance_theta_rad=None))
    servo_um = placement_errors(straight, placement_residual(straight)).left_um
    first = math.hypot(0.05 * math.sqrt(2), 0.12)
    # cut off at .4 um = 2.87 sigma the law is narrower by less than a tenth
    assert first * 0.9 < servo_um < first
    turned = putting(task)
    assert placement_errors(turned, placement_residual(turned)).left_um < 0.7 * first
    share, law = placement_residual(turned).early or (0.0, None)
    # inside .1 of .5 deg, and nearly always inside .4 um
    assert share == pytest.approx(math.erf(0.2 / math.sqrt(2)), rel=0.03)
    swing_um = math.radians(1 / 3600) * math.sqrt(2) * math.hypot(1500, 73)
    assert law is not None
    assert law.sigma_um == pytest.approx(math.hypot(first, swing_um), rel=1e-3)


def test_a_second_alignment_places_closer_what_the_first_turned(task: Task) -> None:
    """It turns nothing, its look tells no angle: those of the first one stay."""
    known = memory(within_um=0.04)
    first = known.seen["submount"]
    again = look("submount.mark", "closer", 0.004)
    known = replace(
        known, seen={**known.seen, "submount": again}, before=first,
        angles={"submount": first},
    )  # fmt: skip
    found = put(both(), known)
    assert found is not None
    one = putting(task)
    assert angle_error(found).rows == angle_error(one).rows
    assert angle_error(found).cut_rad == angle_error(one).cut_rad
    # a disc of .04 um, evenly filled, has .02 um per axis
    assert placement_errors(found, placement_residual(found)).left_um == pytest.approx(
        0.02, rel=0.02
    )
    lost = replace(known, angles={})  # nobody knows the submount's angle any more
    blind = put(both(), lost)
    assert blind is not None
    assert angle_error(blind).rows[1].sigma_rad == pytest.approx(math.radians(0.5))


def test_a_scale_that_looks_share_is_counted_once() -> None:
    known = memory()
    die = replace(
        known.seen["die"], sigma_without_scale_um=0.007, place_um=(0.0, 145.0)
    )
    found = put(read(), replace(known, seen={**known.seen, "die": die}))
    assert found is not None
    rows = {
        row.term: row
        for row in placement_errors(found, placement_residual(found)).blind
    }
    assert rows["measurement of die.outline"].sigma_um == 0.007
    assert "which has its own row" in rows["measurement of die.outline"].source
    scale = rows["zoom scale over the distance from the axis"]
    assert scale.sigma_um == pytest.approx(2e-4 * 145)
    assert rows["measurement of submount.mark"].source == "trials"


def test_what_nobody_turns_keeps_its_angle(task: Task) -> None:
    found = angle_error(putting(with_step(task, "over_site", tolerance_theta_rad=None)))
    spread = math.radians(0.5)  # of the submount; the jaws turn the die flat
    assert found.sigma_rad == pytest.approx(spread, rel=1e-3)
    kept = angle_error(putting(task))
    assert kept.sigma_rad < math.radians(0.1) / math.sqrt(3) + 2e-4


def test_moves_after_the_looks_are_charged(task: Task) -> None:
    """The robot sideways after the look at the die; the stage after the alignment."""
    place = next(step for step in task.steps if step.id == "place")
    for axes, to, of in (
        ("robot", Reading(x_um=5.0), "die"),
        ("stage", Reading(x_um=1502.0), "submount.mark"),
    ):
        also = Move(axes=axes, to=to, where=place.where)  # type: ignore[arg-type]  # one of both
        moved = putting(with_step(task, "place", move=(also, *place.move)))
        rows = {
            r.term: r.sigma_um
            for r in placement_errors(moved, placement_residual(moved)).blind
        }
        term = f"{axes} moved since the look at {of}"
        assert rows[term] == pytest.approx(0.05 * math.sqrt(2))


def test_without_an_alignment_all_that_is_unknown_is_left(task: Task) -> None:
    steps = tuple(step for step in task.steps if step.id != "over_site")
    found = putting(replace(task, steps=steps))
    left = placement_residual(found)
    # the submount's 10 um; the jaws' die as it was aligned before
    assert left.residual.sigma_um == pytest.approx(10.0, rel=0.2)
    assert placement_errors(found, left).miss > 0.99


def test_nothing_is_placed_where_nobody_looks_or_a_shaft_holds(task: Task) -> None:
    steps = tuple(step for step in task.steps if step.verb != "verify")
    assert placed(replace(task, steps=steps), memory()) is None
    gear = examples.read(examples.EXAMPLE / "task.yaml")
    states = unfold(gear, Report())
    here = next(state for state in states if state.step.verb == "release")
    known = replace(memory(), seen={"gear": look("gear.bore", "see", 0.1)})
    assert place_budget(gear, states, here, known, EFFECTS) is None


def test_the_goal_counts_a_placement_once(task: Task, found: Found) -> None:
    assert found[0].analysis is not None
    shares = found[0].analysis.required_probability
    assert shares == pytest.approx(math.sqrt(0.95))  # a grasp and a release
    assert shares == share_of_goal(task)
