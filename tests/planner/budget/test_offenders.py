"""Largest sizes of an insertion's terms, of outlines as of round fits."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from benchmarks.compiling.outline_shapes import chain, d_shape, hollow
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.budget.insertion import ALL, ANGLE, SERVO, SIZE, Insertion
from microplan.planner.budget.offenders import SHARP, changes, edge, largest_um
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.fit_probability import Residual, RoundFit
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.schemas.plan import BudgetRow
from microplan.schemas.plan.verdicts import TurnRow

GOAL = 0.98
SIZES_UM = {SERVO: 0.3, SIZE: 0.1, ANGLE: 0.05, "look": 0.25}


def circle(radius: float) -> Outline:
    return chain(
        [Arc(center=(0, 0), radius_um=radius, start_rad=0, sweep_rad=math.tau)]
    )


def job_of(fit: RoundFit | OutlineFit, angle: AngleError | None = None) -> Insertion:
    return Insertion(
        fit=fit,
        residual=Residual(sigma_um=0.3, within_um=0.7),
        blind=(BudgetRow(term="look", sigma_um=0.25, source="test"),),
        angle=angle,
    )


def outline_fit(hole: Outline, peg: Outline) -> OutlineFit:
    return OutlineFit(
        shape=PegInHole(hole=hollow(hole), peg=peg),
        hole_tolerance_um=0.1,
        shaft_tolerance_um=0.0,
    )


def keyed() -> Insertion:
    row = TurnRow(term="angle", sigma_rad=2e-3, source="test")
    return job_of(
        outline_fit(d_shape(25.0, 16.0), d_shape(23.2, 14.2)),
        AngleError(left_rad=0.0, cut_rad=math.inf, rows=(row,)),
    )


@pytest.mark.parametrize("key", SIZES_UM)
def test_a_keyed_fit_has_its_goal_up_to_the_largest_size(key: str) -> None:
    job, size_um = keyed(), SIZES_UM[key]
    largest = largest_um(job, key, size_um, GOAL)
    assert largest is not None
    assert largest > size_um
    # a root is right to SHARP, and P over the angle to SHARP of a miss besides
    within, beyond = (1 - 2 * SHARP, 1 + 2 * SHARP)
    assert 1 - job.scaled(key, within * largest / size_um).miss >= GOAL
    assert 1 - job.scaled(key, beyond * largest / size_um).miss < GOAL


@pytest.mark.parametrize(
    ("key", "goal"), [(SERVO, 0.9), (SIZE, 0.9), ("look", 0.9), ("look", 0.999)]
)
def test_circles_tolerate_what_a_round_fit_does(key: str, goal: float) -> None:
    """Whether the goal is met as it is, 0.9, or is not."""
    round_fit = RoundFit(
        hole_um=25.0, shaft_um=23.7, hole_tolerance_um=0.1, shaft_tolerance_um=0.0
    )
    alike = outline_fit(circle(25.0), circle(23.7))
    found, exact = (
        largest_um(job_of(fit), key, SIZES_UM[key], goal) for fit in (alike, round_fit)
    )
    assert exact is not None
    # polygons of arcs: the room is right to 1e-3 of itself, sizes to a few times that
    assert found == pytest.approx(exact, rel=0.01)


def test_what_is_needed_of_a_keyed_fit_reaches_the_goal() -> None:
    job, goal = keyed(), 1 - 1e-7
    found = changes(job, (), goal)
    assert len(found) == 2
    for change in found:
        assert change.success_probability >= goal
        assert change.halvings > 0
    assert changes(job, (), 0.5) == ()
    assert changes(job.scaled(ALL, 0.1), (), goal) == ()


def test_a_fit_without_room_has_no_largest_size() -> None:
    job = keyed()
    assert isinstance(job.fit, OutlineFit)
    tight = replace(job, fit=job.fit.widened(-2.5))
    assert tight.fit.capture_um == 0
    assert largest_um(tight, SERVO, 0.3, GOAL) is None
    wider = changes(tight, (), GOAL)
    assert [change.what.split()[0] for change in wider] == ["widen"]
    assert wider[0].success_probability >= GOAL


@pytest.mark.parametrize(("low", "high"), [(0.0, 10.0), (2.0, 4.0), (3.0, 3.1)])
def test_an_edge_is_found_from_below(low: float, high: float) -> None:
    found = edge(lambda size: math.pi - size, low, high)
    assert min(math.pi, high) * (1 - SHARP) < found <= min(math.pi, high)


def test_an_edge_at_an_end_is_that_end() -> None:
    assert edge(lambda size: 2.0 - size, 2.0, 5.0) == pytest.approx(2.0, rel=SHARP)
    assert edge(lambda size: -1.0 if size > 0 else 0.0, 0.0, 1.0) == 0.0
    assert edge(lambda _: 1.0, 0.0, 7.0) == 7.0
