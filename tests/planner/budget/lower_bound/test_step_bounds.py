"""The worst corner of the biases against closed forms and against draws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ncx2, norm

from benchmarks.compiling.outline_shapes import box, hollow
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.lower_bound.bounded_history import (
    bias_rad,
    bias_um,
    bounded,
    model_bias_um,
)
from microplan.planner.budget.lower_bound.sample_bounds import sigma_factor
from microplan.planner.budget.lower_bound.step_bounds import worst_miss
from microplan.planner.budget.probability.fit_probability import Residual, RoundFit
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.schemas.plan import BudgetRow, ModelCost, Repeatability
from tests.planner.placed import look

CAPTURE_UM = 3.0
NONE = Residual(sigma_um=0.0, within_um=0.0)
# probabilities are averaged to this over the wide axis of the errors
CLOSE = 2e-5


def insertion(
    sigma_um: float,
    along_um: float = 0.0,
    *,
    offset_um: float = 0.0,
    residual: Residual = NONE,
) -> Insertion:
    return Insertion(
        fit=RoundFit(
            hole_um=22.0 + CAPTURE_UM, shaft_um=22.0, hole_tolerance_um=0.0,
            shaft_tolerance_um=0.0,
        ),
        residual=residual,
        blind=(
            BudgetRow(term="round", sigma_um=sigma_um, source=""),
            BudgetRow(term="along", sigma_um=along_um, source="", along_rad=0.4),
        ),
        offset_um=offset_um,
    )  # fmt: skip


@pytest.mark.parametrize(("offset_um", "biased_um"), [(0.0, 0.7), (1.1, 0.7)])
def test_a_bias_of_round_errors_is_a_rice_law_away(
    offset_um: float, biased_um: float
) -> None:
    """The worst bias beside an offset is along it."""
    found = worst_miss(insertion(0.9, offset_um=offset_um), biased_um, 0.0)
    far = (offset_um + biased_um) / 0.9
    assert found == pytest.approx(ncx2.sf((CAPTURE_UM / 0.9) ** 2, 2, far**2))


def test_a_bias_across_an_offset_counts_where_that_is_worse() -> None:
    """Errors lie along one line, at an angle to the offset; drawn in 16 directions."""
    job = insertion(0.05, 1.2, offset_um=0.5)
    rng = np.random.default_rng(2)
    errors = rng.normal(0, 0.05, (400_000, 2))
    errors += rng.normal(0, 1.2, (400_000, 1)) * [math.cos(0.4), math.sin(0.4)]
    drawn = [
        np.mean(np.hypot(*(errors + [0.5 + math.cos(w), math.sin(w)]).T) > CAPTURE_UM)
        for w in np.linspace(0, 2 * math.pi, 17)
    ]
    worst = max(drawn)
    error = 4 * math.sqrt(worst * (1 - worst) / len(errors))
    found = worst_miss(job, 1.0, 1.0)
    # eight directions come within pi / 8 of the worst: 8 % of the bias along it
    less = worst_miss(job, math.cos(math.pi / 8), 0.0)
    assert less - error <= worst <= found + error + (found - less)


def test_alignments_that_end_at_once_have_the_bias_of_their_approach() -> None:
    later = insertion(0.6, residual=Residual(sigma_um=0.4, within_um=1.0))
    early = Residual(sigma_um=0.9, within_um=1.0)
    swung = Residual(sigma_um=2.0, within_um=1.0)
    job = replace(later, early=(0.25, early), turned=(0.35, swung))
    expected = 0.25 * worst_miss(replace(later, residual=early), 0.8, 0.0)
    expected += 0.35 * worst_miss(replace(later, residual=swung), 0.2, 0.0)
    expected += 0.4 * worst_miss(later, 0.2, 0.0)
    assert worst_miss(job, 0.2, 0.8) == pytest.approx(expected)


def test_a_bias_of_outlines_counts_in_the_direction_that_has_least_room() -> None:
    shape = PegInHole(hole=hollow(box(40.0, 11.0)), peg=box(30.0, 10.0))
    job = replace(
        insertion(0.3),
        fit=OutlineFit(shape=shape, hole_tolerance_um=0.0, shaft_tolerance_um=0.0),
        hole_rad=0.2,
    )
    # the walls are 1 um away in y of the hole, and 10 um in x; less room on both
    # sides of y is as bad as the worst direction or worse
    across = norm.sf((1 - 0.8) / 0.3)
    assert across <= worst_miss(job, 0.8, 0.0) <= 2 * across + CLOSE
    beside = replace(job, offset_um=0.15, offset_rad=0.2 + math.pi / 2)
    assert worst_miss(beside, 0.8, 0.0) >= norm.sf((1 - 0.8 - 0.15) / 0.3)


@settings(max_examples=40)
@given(
    sigma_um=st.floats(0.05, 3),
    along_um=st.floats(0, 3),
    offset_um=st.one_of(st.just(0.0), st.floats(0.01, 4)),
    bias=st.floats(0, 4),
)
def test_no_bias_makes_a_miss_rarer_and_a_longer_one_none_rarer(
    sigma_um: float, along_um: float, offset_um: float, bias: float
) -> None:
    job = insertion(sigma_um, along_um, offset_um=offset_um)
    misses = [worst_miss(job, share * bias, 0.0) for share in (0.0, 0.5, 1.0)]
    assert misses[0] == job.miss
    assert misses[0] <= misses[1] + CLOSE <= misses[2] + 2 * CLOSE


KNOWN = Repeatability(
    trials=64, answered=60, undetected=0, sigma_um=(0.03, 0.03), kurtosis=4.0,
    half_width_um=(0.003, 0.004), kurtosis_theta=3.0, bias_theta_rad=-0.002,
    half_width_theta_rad=0.001,
)  # fmt: skip


def test_only_what_was_measured_has_an_end() -> None:
    seen = replace(
        look("part", "see", 0.05, sigma_theta_rad=0.01), moved_um=0.04,
        sigma_without_scale_um=math.inf,
    )  # fmt: skip
    assert bounded(seen, 0.01) == seen  # how well it is known is not known
    assert (bias_um(seen, 0.01), bias_rad(None, 0.01)) == (0.0, 0.0)
    known = replace(seen, repeatability=KNOWN)
    end, factor = bounded(known, 0.01), sigma_factor(60, 4.0, 0.01)
    assert end.sigma_um == pytest.approx(math.hypot(0.04, 0.03 * factor))
    assert end.sigma_without_scale_um == math.inf
    assert end.sigma_theta_rad == pytest.approx(0.01 * sigma_factor(60, 3.0, 0.01))
    assert bias_um(known, 0.05) == pytest.approx(0.005)
    assert bias_rad(known, 0.05) == pytest.approx(0.003)


def test_what_images_cost_has_ends_of_its_own() -> None:
    """Of its own pairs: 12, and 6 degrees of freedom of the mean, as tables have t."""
    cost = ModelCost(
        pairs=12, freedom=6, bias_um=(0.1, 0.2), half_width_um=(0.05, 0.0),
        interval_um=(0.02, 0.0), sigma_um=(0.02, 0.01), bias_theta_rad=-1e-3,
        half_width_theta_rad=3e-3, interval_theta_rad=1e-3, sigma_theta_rad=4e-3,
    )  # fmt: skip
    seen = replace(
        look("part", "see", math.hypot(0.03, 0.02), sigma_theta_rad=5e-3),
        repeatability=KNOWN, model_cost=cost,
    )  # fmt: skip
    end = bounded(seen, 0.01)
    trials, pairs = sigma_factor(60, 4.0, 0.01), sigma_factor(12, 3.0, 0.01)
    assert pairs > trials
    assert end.sigma_um == pytest.approx(math.hypot(0.03 * trials, 0.02 * pairs))
    turn = math.hypot(3e-3 * sigma_factor(60, 3.0, 0.01), 4e-3 * pairs)
    assert end.sigma_theta_rad == pytest.approx(turn)
    # the interval is no wider at a smaller doubt; the rest by t of 6: 3.707 over 2.447
    assert model_bias_um(seen, 0.05) == pytest.approx(0.05)
    expected = 0.02 + 0.03 * 3.70743 / 2.44691
    assert model_bias_um(seen, 0.01) == pytest.approx(expected, rel=1e-5)
    drawn = replace(cost, drawn_um=(0.3, 0.0), drawn_theta_rad=2e-3)
    at_worst = replace(seen, model_cost=drawn)  # walls and faces: no doubt widens them
    assert model_bias_um(at_worst, 0.01) == pytest.approx(expected + 0.3, rel=1e-5)
    assert bias_rad(at_worst, 0.01) == pytest.approx(bias_rad(seen, 0.01) + 2e-3)
    assert bounded(at_worst, 0.01).sigma_um == end.sigma_um
    apart = replace(cost, spread_um=(0.05, 0.03), spread_theta_rad=6e-3)
    wide = bounded(replace(seen, model_cost=apart), 0.01)  # all that answers differ by
    assert wide.sigma_um == pytest.approx(math.hypot(0.03 * trials, 0.05 * pairs))
    turn = math.hypot(3e-3 * sigma_factor(60, 3.0, 0.01), 6e-3 * pairs)
    assert wide.sigma_theta_rad == pytest.approx(turn)
    assert bias_um(seen, 0.05) == pytest.approx(0.005)  # that of the trials stays
    assert bias_rad(seen, 0.05) == pytest.approx(0.003 + 1e-3 + 3e-3)
    assert model_bias_um(None, 0.05) == model_bias_um(look("a", "b", 1.0), 0.05) == 0


@pytest.mark.parametrize("spared_um", [(0.02, 0.01), (0.09, 0.09)])
@pytest.mark.parametrize("true_um", [0.0, 0.025])
def test_what_images_spare_a_look_is_no_part_of_its_bound(
    spared_um: tuple[float, float], true_um: float
) -> None:
    """By its own cost alone, whatever its fallback's is, and where the cap is met."""
    own = ModelCost(
        pairs=12, freedom=6, bias_um=(0.0, 0.0), half_width_um=(0.0, 0.0),
        interval_um=(0.0, 0.0), sigma_um=(0.0, 0.0), spared_um=spared_um,
    )  # fmt: skip
    either = replace(own, spared_um=(0.0, 0.0))
    charged_um = own.charged_um(0.03, true_um)
    assert true_um < charged_um < 0.03
    seen = replace(
        look("part", "see", math.hypot(charged_um, 0.04)), repeatability=KNOWN,
        model_cost=either, own_cost=own, trueness_um=true_um, moved_um=0.04,
        sigma_without_scale_um=math.hypot(charged_um, 0.04),
    )  # fmt: skip
    expected = math.hypot(0.03 * sigma_factor(60, 4.0, 0.01), 0.04)
    found = bounded(seen, 0.01)
    assert found.sigma_um == pytest.approx(expected)
    assert found.sigma_without_scale_um == pytest.approx(expected)
