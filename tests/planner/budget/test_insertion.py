"""An insertion's chance against draws; its offenders against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import binom

from microplan.planner.budget.insertion import OFFSET, SERVO, SIZE, Insertion
from microplan.planner.budget.offenders import (
    SHARP,
    changes,
    offenders,
    sizes_of,
    yield_over_shaft,
    yield_over_tolerance,
)
from microplan.planner.budget.probability.fit_probability import Residual, RoundFit
from microplan.schemas.plan import BudgetRow

NONE = Residual(sigma_um=0.0, within_um=0.0)
SAMPLES = 1_000_000


def fit(capture_um: float = 3.0, tolerance_um: float = 0.0) -> RoundFit:
    return RoundFit(
        hole_um=22.0 + capture_um, shaft_um=22.0, hole_tolerance_um=tolerance_um,
        shaft_tolerance_um=tolerance_um,
    )  # fmt: skip


def row(term: str, sigma_um: float, along_rad: float | None = None) -> BudgetRow:
    return BudgetRow(term=term, sigma_um=sigma_um, source="test", along_rad=along_rad)


def insertion(
    *rows: BudgetRow, residual: Residual = NONE, offset_um: float = 0.0,
    offset_rad: float = 0.0, tolerance_um: float = 0.0,
) -> Insertion:  # fmt: skip
    return Insertion(
        fit=fit(3.0, tolerance_um), residual=residual, blind=rows,
        offset_um=offset_um, offset_rad=offset_rad,
    )  # fmt: skip


def drawn(job: Insertion, seed: int) -> int:
    """Return how many of SAMPLES insertions miss, every error drawn by itself."""
    rng = np.random.default_rng(seed)
    error = np.zeros((SAMPLES, 2))
    if job.residual.sigma_um > 0:
        outside = np.ones(SAMPLES, dtype=bool)
        while outside.any():
            count = int(outside.sum())
            error[outside] = rng.normal(0, job.residual.sigma_um, (count, 2))
            outside = np.hypot(error[:, 0], error[:, 1]) >= job.residual.within_um
    error[:, 0] += job.offset_um * math.cos(job.offset_rad)
    error[:, 1] += job.offset_um * math.sin(job.offset_rad)
    for each in job.blind:
        if each.along_rad is None:
            error += rng.normal(0, each.sigma_um or 0.0, (SAMPLES, 2))
        else:
            along = rng.normal(0, each.sigma_um or 0.0, SAMPLES)
            error[:, 0] += along * math.cos(each.along_rad)
            error[:, 1] += along * math.sin(each.along_rad)
    reach = (job.fit.hole_tolerance_um, job.fit.shaft_tolerance_um)
    room = job.fit.capture_um + sum(t * rng.uniform(-1, 1, SAMPLES) for t in reach)
    return int((np.hypot(error[:, 0], error[:, 1]) >= room).sum())


SERVOED = Residual(sigma_um=1.29, within_um=1.4)
JOBS = [
    insertion(row("all", 1.0), residual=SERVOED, tolerance_um=0.3),
    insertion(row("all", 0.6), row("x", 1.2, 0.0), residual=SERVOED, tolerance_um=0.3),
    insertion(row("all", 0.5), row("y", 1.5, 1.5), residual=SERVOED, offset_um=0.8),
    insertion(row("a", 0.9, 0.3), row("b", 0.9, 2.0), residual=SERVOED),
    insertion(row("line", 1.5, 0.7), residual=SERVOED, tolerance_um=0.2),
    insertion(row("line", 1.0, 0.7), row("all", 0.3), offset_um=1.0, tolerance_um=0.3),
    insertion(
        row("x", 0.8, 0.0), residual=Residual(sigma_um=1.2, within_um=math.inf),
        tolerance_um=0.3,
    ),
    insertion(row("y", 1.5, 1.5), residual=SERVOED, offset_um=1.8, offset_rad=1.2),
    insertion(
        row("x", 0.9, 0.0), row("all", 0.8), offset_um=1.8, offset_rad=2.0,
        residual=Residual(sigma_um=0.5, within_um=math.inf),
    ),
]  # fmt: skip


@pytest.mark.parametrize("index", range(len(JOBS)))
def test_chances_with_directions_are_those_of_drawing(index: int) -> None:
    job = JOBS[index]
    missed, p = drawn(job, 40 + index), job.miss
    share = 1e-3 / len(JOBS) / 2  # one run in a thousand fails by chance
    assert 0.001 < p < 0.5
    assert binom.cdf(missed, SAMPLES, p) > share
    assert binom.sf(missed - 1, SAMPLES, p) > share


def test_round_offenders_are_those_of_the_closed_form() -> None:
    """P = 1 - exp(-r**2 / 2 S**2), S**2 = a**2 + b**2."""
    a, b, goal = 1.1, 0.5, 0.95
    job = insertion(row("a", a), row("b", b))
    sizes = sizes_of(job, "servo", "offset", "size")
    found = {o.term: o for o in offenders(job, sizes, goal)}
    assert list(found) == ["a", "b"]  # what is zero offends nobody; the worst first
    square = a * a + b * b
    for term, size, other in (("a", a, b), ("b", b, a)):
        slope = -math.exp(-9 / 2 / square) * 9 / square**2 * size
        assert found[term].slope_per_um == pytest.approx(slope, rel=1e-5)
        half = 1 - math.exp(-9 / 2 / (other**2 + size**2 / 4))
        assert found[term].halved_probability == pytest.approx(half, rel=1e-9)
        most = -9 / 2 / math.log(1 - goal) - other**2
        largest = found[term].largest_um
        assert most > 0
        assert largest == pytest.approx(math.sqrt(most), rel=SHARP)


def test_the_cheapest_change_comes_first_and_does_it() -> None:
    goal = 0.99
    job = insertion(row("large", 1.2), row("small", 0.3))
    found = offenders(job, sizes_of(job, "servo", "offset", "size"), goal)
    ways = changes(job, found, goal, [("another", 0.995), ("worse", 0.5)])
    assert ways[0].what == "use another"
    assert not any("worse" in way.what or "small" in way.what for way in ways)
    assert [w.halvings for w in ways] == sorted(w.halvings for w in ways)
    wide = next(w for w in ways if "widen" in w.what)
    assert wide.success_probability >= goal
    # r that S asks for: sqrt(-2 S**2 ln(1 - P)), on the diameter
    radius = math.sqrt(-2 * (1.2**2 + 0.3**2) * math.log(1 - goal))
    assert f"{2 * (radius - 3.0):.2f}"[:3] in wide.what
    bring = next(w for w in ways if "'large'" in w.what)
    assert bring.halvings == pytest.approx(
        math.log2(1.2 / math.sqrt(-9 / 2 / math.log(1 - goal) - 0.09)), abs=2e-3
    )
    assert changes(job, found, 0.5) == ()


def test_what_no_change_of_one_term_mends_says_so() -> None:
    job = insertion(row("a", 2.0), row("b", 2.0))
    found = offenders(job, sizes_of(job, "servo", "offset", "size"), 0.95)
    assert [o.largest_um for o in found] == [None, None]
    wide, finer = changes(job, found, 0.95)
    # 2 (sqrt(-2 * 8 ln .05) - 3) = 7.847 um, found to a thousandth
    assert wide.what in ("widen the hole by 7.85 um", "widen the hole by 7.86 um")
    # both axes of one factor: 3 / sqrt(-2 * 8 ln .05) = .4333
    assert finer.what.startswith("bring every error and tolerance to 43.3 %")
    assert wide.halvings == pytest.approx(finer.halvings, abs=3e-3)


def test_every_term_can_be_scaled() -> None:
    job = insertion(row("a", 0.4), residual=SERVOED, offset_um=0.5, tolerance_um=0.3)
    for key, _, _ in [(SERVO, 0, 0), (OFFSET, 0, 0), (SIZE, 0, 0), ("a", 0, 0)]:
        assert job.scaled(key, 1.0).miss == pytest.approx(job.miss)
        assert job.scaled(key, 1.5).miss > job.miss > job.scaled(key, 0.5).miss


def test_yield_falls_as_the_pin_and_the_tolerance_grow() -> None:
    job = insertion(row("all", 0.8), tolerance_um=0.3)
    shaft = yield_over_shaft(job).points
    assert shaft[-1].value_um == pytest.approx(50.0)
    for before, after in pairwise(shaft):
        assert after.value_um > before.value_um
        assert after.success_probability <= before.success_probability
    loose = yield_over_tolerance(job).points
    assert loose[0].value_um == 0.0
    exact = 1 - math.exp(-9 / 2 / 0.64)
    assert loose[0].success_probability == pytest.approx(exact)
    for before, after in pairwise(loose):
        assert after.success_probability <= before.success_probability
    tight = yield_over_tolerance(insertion(row("all", 0.8))).points
    assert len(tight) == 1


def test_one_more_offset_counts_in_its_worst_direction() -> None:
    """Round errors know no worst one; of others all directions are tried."""
    round_job = insertion(row("a", 1.0), tolerance_um=0.2)
    wanted = insertion(row("a", 1.0), tolerance_um=0.2, offset_um=0.7).miss
    assert round_job.missed_with(0.7) == pytest.approx(wanted, rel=1e-9)
    leaning = insertion(row("a", 0.5), row("b", 0.9, 0.4))
    turned = [
        insertion(row("a", 0.5), row("b", 0.9, angle), offset_um=0.7).miss
        for angle in np.linspace(0, math.pi, 13)
    ]
    assert leaning.missed_with(0.7) == pytest.approx(max(turned), rel=1e-3)
    assert leaning.missed_with(0.0) == leaning.miss
    offset = insertion(row("a", 0.5), offset_um=0.3)
    both = insertion(row("a", 0.5), offset_um=1.0).miss
    assert offset.missed_with(0.7) == pytest.approx(both, rel=1e-12)


def test_what_turned_and_what_ended_early_are_shares_of_all_draws() -> None:
    """By draws of each share alone; what halves the servo's part halves all three."""
    swung = Residual(sigma_um=2.2, within_um=math.inf)
    job = replace(
        insertion(row("all", 0.6), residual=SERVOED, tolerance_um=0.3),
        early=(0.25, Residual(sigma_um=0.9, within_um=1.4)), turned=(0.35, swung),
    )  # fmt: skip
    each = [(w, replace(job, residual=left, early=None, turned=None))
            for w, left in job.shares]  # fmt: skip
    assert [share for share, _ in each] == pytest.approx([0.4, 0.25, 0.35])
    found = sum(w * drawn(alone, seed) for seed, (w, alone) in enumerate(each))
    assert job.miss == pytest.approx(found / SAMPLES, rel=0.02)
    halved = job.scaled(SERVO, 0.5)
    wanted = sum(w * alone.scaled(SERVO, 0.5).miss for w, alone in each)
    assert halved.miss == pytest.approx(wanted)
    assert job.left_um**2 == pytest.approx(sum(w * one.left_um**2 for w, one in each))
