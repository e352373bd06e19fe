"""Insertions of keyed posts: what P counts, against draws of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.compiling.outline_pairs import goes_in
from benchmarks.compiling.outline_shapes import d_shape, hollow
from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.budget.insert_budget import insert_budget
from microplan.planner.budget.insertion import Insertion, LateralResidual
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.schemas.plan import BudgetRow
from microplan.schemas.plan.verdicts import TurnRow

SHAPE = PegInHole(hole=hollow(d_shape(25.0, 16.0)), peg=d_shape(23.5, 14.5))
HOLE_RAD = 0.7  # of the hole in the world


def keyed(**values: object) -> Insertion:
    row = TurnRow(term="angle of post", sigma_rad=0.02, source="test")
    job = Insertion(
        fit=OutlineFit(shape=SHAPE, hole_tolerance_um=0.0, shaft_tolerance_um=0.0),
        residual=Residual(sigma_um=0.4, within_um=0.6),
        blind=(
            BudgetRow(term="look", sigma_um=0.3, source="test"),
            BudgetRow(term="swing", sigma_um=0.7, source="test", along_rad=0.3),
        ),
        offset_um=0.4,
        offset_rad=-0.5,
        angle=AngleError(left_rad=0.0, cut_rad=math.inf, rows=(row,)),
        hole_rad=HOLE_RAD,
        lever_um=(8.0, -3.0),
    )
    return replace(job, **values)  # type: ignore[arg-type]


def drawn(job: Insertion, count: int, rng: np.random.Generator) -> float:
    """Return the share of draws that go in, in world coordinates."""
    left = rng.normal(0, job.residual.sigma_um, (4 * count, 2))
    place = left[np.hypot(*left.T) <= job.residual.within_um][:count]
    place += job.offset_um * way(job.offset_rad)
    place += rng.normal(0, 0.3, (count, 2))
    place += rng.normal(0, 0.7, (count, 1)) * way(0.3)
    turn = rng.normal(0, 0.02, count)
    place += turn[:, None] * np.array(job.lever_um)
    # the hole is at `place` in the world, about the post
    c, s = math.cos(HOLE_RAD), math.sin(HOLE_RAD)
    in_hole = -place @ np.array([[c, -s], [s, c]])
    poses = np.column_stack([in_hole, turn])
    return float(goes_in(SHAPE.hole, SHAPE.peg, poses).mean())


def way(angle: float) -> FloatArray:
    return np.array([math.cos(angle), math.sin(angle)])


def test_an_insertion_of_outlines_agrees_with_draws_in_the_world() -> None:
    job, count = keyed(), 20_000
    share = drawn(job, count, np.random.default_rng(8))
    assert 0.2 < share < 0.9
    assert abs(1 - job.miss - share) < 4 * math.sqrt(share * (1 - share) / count)


def test_an_early_stop_is_a_mixture() -> None:
    other = Residual(sigma_um=0.2, within_um=0.6)
    both = keyed(early=(0.3, other)).miss
    assert both == pytest.approx(0.3 * keyed(residual=other).miss + 0.7 * keyed().miss)


def test_the_budget_names_the_angle_among_what_costs_most() -> None:
    bare = BudgetRow(term="look", sigma_um=0.3, source="test")
    job = keyed(
        lever_um=(0.0, 0.0),
        offset_um=0.0,
        blind=(bare,),
        residual=Residual(sigma_um=0.0, within_um=0.0),
    )
    left = LateralResidual(residual=job.residual, term="servo", source="test")
    budget = insert_budget(job, left, goal=0.9)
    rows = {row.term: row for row in budget.rows}
    # 20 mrad at 23.5 um
    angle = rows["angle between hole and shaft"]
    assert angle.sigma_um == pytest.approx(0.47, rel=0.01)
    assert budget.analysis is not None
    terms = [worst.term for worst in budget.analysis.offenders]
    assert "angle between hole and shaft" in terms
    assert budget.success_probability == pytest.approx(1 - job.miss)
    less = job.scaled("angle", 0.5)
    assert less.angle is not None
    assert less.angle.sigma_rad == pytest.approx(0.01)
    assert less.miss < job.miss
    assert job.widened(1.0).miss < job.miss
