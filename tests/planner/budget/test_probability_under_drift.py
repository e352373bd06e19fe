"""How far a setting may be off, asked of errors whose law is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ncx2

from microplan.featuresel.trials.outcomes import Outcome
from microplan.planner.budget.budget import FOCUS_TERM, PICTURES
from microplan.planner.budget.drift_since_look import DriftTolerance, is_placed
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.probability.fit_probability import Residual, RoundFit
from microplan.schemas.plan import BudgetRow

LOOK = "measurement of gear.bore"
RADIUS_UM = 3.0


def job(look_um: float, focus_um: float = 0.0) -> Insertion:
    """Return an insertion of 3 um room with the errors of a look and of its lens."""
    rows = ((LOOK, look_um), (FOCUS_TERM, focus_um))
    return Insertion(
        fit=RoundFit(
            hole_um=25.0, shaft_um=22.0, hole_tolerance_um=0.0, shaft_tolerance_um=0.0
        ),
        residual=Residual(sigma_um=0.0, within_um=0.0),
        blind=tuple(BudgetRow(term=t, sigma_um=s, source="test") for t, s in rows),
    )


def outcomes(errors: Sequence[tuple[float, float] | None]) -> list[Outcome]:
    return [
        Outcome(
            chain=("otsu",), trial=k, failure="none" if e is None else None,
            world_um=e, target_um=e, theta_rad=None, score=None, spread_um=None,
        )
        for k, e in enumerate(errors)
    ]  # fmt: skip


def borne(goal: float, of: Insertion, **more: object) -> DriftTolerance:
    given = {"setting": "zoom", "bias_um": (0.0, 0.0), **more}
    return DriftTolerance(job=of, goal=goal, term=LOOK, **given)  # type: ignore[arg-type] # mixed values


def beyond(sigma_um: float, offset_um: float) -> float:
    """Return Rice's chance of an error beyond the radius, by scipy."""
    square = (RADIUS_UM / sigma_um) ** 2
    return float(ncx2.sf(square, 2, (offset_um / sigma_um) ** 2))


@pytest.mark.parametrize("offset_um", [0.3, 1.1])
def test_the_mean_is_an_offset_and_the_trials_sigma_the_least_spread(
    offset_um: float,
) -> None:
    same = outcomes([(offset_um + 0.2, 0.1)] * 4)
    chance = 1 - beyond(0.8, offset_um)
    asked = {"of": job(0.8), "bias_um": (0.2, 0.1)}
    assert borne(chance - 1e-6, **asked)(0.01, same)  # type: ignore[arg-type] # ditto
    assert not borne(chance + 1e-6, **asked)(0.01, same)  # type: ignore[arg-type] # ditto


def test_draws_that_scatter_more_than_the_trials_count_as_they_scatter() -> None:
    draws = np.array([(1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)])
    sigma_um = math.sqrt(8 / 6)  # eight squares of 1 over 2 (4 - 1) degrees of freedom
    chance = 1 - beyond(sigma_um, 0.0)
    found = outcomes([(float(x), float(y)) for x, y in draws])
    assert borne(chance - 1e-6, job(0.5))(0.01, found)
    assert not borne(chance + 1e-6, job(0.5))(0.01, found)


def test_the_lens_shifts_more_the_farther_the_focus_is_off() -> None:
    same = outcomes([(0.0, 0.0)] * 4)
    chance = 1 - beyond(math.hypot(0.5, 0.2 + 0.01 * 40), 0.0)
    for side in (-40.0, 40.0):
        more = {"setting": "focus", "lateral_um": 0.01}
        assert borne(chance - 1e-6, job(0.5, 0.2), **more)(side, same)
        assert not borne(chance + 1e-6, job(0.5, 0.2), **more)(side, same)


def test_no_answer_is_not_borne() -> None:
    found = outcomes([(0.0, 0.0), None])
    assert [is_placed(outcome) for outcome in found] == [True, False]


def test_what_pictures_add_counts_once_where_draws_scatter_by_it() -> None:
    """The draws' discrepancy is in their scatter, and in a row of its own."""
    draws = np.array([(1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)])
    scatter_um = math.sqrt(8 / 6)
    found = outcomes([tuple(each) for each in draws.tolist()])
    whole = job(0.1)
    row = BudgetRow(term=f"{PICTURES} of gear.bore", sigma_um=0.9, source="test")
    parted = replace(whole, blind=(*whole.blind, row))
    chance = 1 - beyond(scatter_um, 0.0)
    for each in (whole, parted):
        assert borne(chance - 1e-4, of=each)(0.01, found)
        assert not borne(chance + 1e-4, of=each)(0.01, found)
