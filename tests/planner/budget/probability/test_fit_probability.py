"""P(insert) and servo figures, against Monte Carlo, mpmath and closed forms."""

from __future__ import annotations

import math

import mpmath  # type: ignore[import-untyped]  # has no stubs
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from microplan.planner.budget.probability.fit_probability import (
    EASY_SIGMAS,
    SERVO_SHARE,
    Residual,
    RoundFit,
    combine,
    expected_looks,
    miss_probability,
    servo_tolerance_um,
)
from microplan.planner.views.alignments import LEAST_SIGMAS

NONE = Residual(sigma_um=0.0, within_um=0.0)  # a servo that leaves nothing
SAMPLES = 2_000_000


def fit(capture_um: float, tolerance_um: float = 0.0) -> RoundFit:
    return RoundFit(
        hole_um=22.0 + capture_um,
        shaft_um=22.0,
        hole_tolerance_um=tolerance_um,
        shaft_tolerance_um=tolerance_um,
    )


PAPER = fit(3.0, 0.3)  # a 50 um bore over a 44 um post


def sampled_miss(
    found: RoundFit, residual: Residual, sigma_um: float, bias_um: float, seed: int
) -> float:
    """Return the share of misses among SAMPLES insertions, drawn one by one."""
    rng = np.random.default_rng(seed)
    error = np.zeros((SAMPLES, 2))
    if residual.sigma_um > 0:
        outside = np.ones(SAMPLES, dtype=bool)
        while outside.any():  # what ends outside is moved again
            error[outside] = rng.normal(0, residual.sigma_um, (int(outside.sum()), 2))
            outside = np.hypot(error[:, 0], error[:, 1]) >= residual.within_um
    error += rng.normal(0, sigma_um, (SAMPLES, 2))
    error[:, 0] += bias_um
    hole = found.hole_um + found.hole_tolerance_um * rng.uniform(-1, 1, SAMPLES)
    shaft = found.shaft_um + found.shaft_tolerance_um * rng.uniform(-1, 1, SAMPLES)
    missed = np.hypot(error[:, 0], error[:, 1]) >= hole - shaft
    return float(missed.mean())


@pytest.mark.parametrize(
    ("found", "residual", "sigma_um", "bias_um"),
    [
        (PAPER, NONE, 1.03, 0.0),
        (PAPER, Residual(sigma_um=1.3, within_um=1.5), 0.6, 0.0),
        (PAPER, Residual(sigma_um=0.2, within_um=1.5), 1.0, 0.0),
        pytest.param(
            fit(0.5, 0.3),
            Residual(sigma_um=0.3, within_um=0.4),
            0.1,
            0.0,
            marks=pytest.mark.slow,
        ),
        (fit(0.2, 0.3), NONE, 0.1, 0.0),  # some shafts are thicker than their hole
        (PAPER, NONE, 1.0, 0.8),
        pytest.param(
            PAPER,
            Residual(sigma_um=1.3, within_um=1.5),
            0.8,
            0.8,
            marks=pytest.mark.slow,
        ),
        (PAPER, Residual(sigma_um=1.3, within_um=1.5), 0.3, 1.4),
    ],
)
def test_the_chance_of_a_miss_is_that_of_drawing(
    found: RoundFit, residual: Residual, sigma_um: float, bias_um: float
) -> None:
    p = miss_probability(found, residual, sigma_um, bias_um)
    share = sampled_miss(found, residual, sigma_um, bias_um, seed=7)
    # four standard errors of a share: one run in 16 000 fails by chance
    assert share == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / SAMPLES))
    assert 0.001 < p < 0.999


def marcum(a: float, b: float) -> float:
    """Return P(|a + n| >= b) for unit normal n in the plane, by mpmath."""
    with mpmath.workdps(30):

        def density(x: mpmath.mpf) -> mpmath.mpf:
            # exp(-(x - a)**2 / 2) times the scaled Bessel function: no overflow
            bessel = mpmath.besseli(0, a * x) * mpmath.exp(-a * x)
            return x * mpmath.exp(-((x - a) ** 2) / 2) * bessel

        cuts = [b, b + 0.1, b + 0.5, b + 2, b + 6, b + 20]
        return float(mpmath.quad(density, cuts))


@pytest.mark.parametrize(
    ("capture_um", "bias_um", "sigma_um"),
    [
        (3.0, 0.0, 1.0),
        (3.0, 1.0, 1.0),
        (3.0, 2.9, 0.5),
        (3.0, 0.5, 0.3),
        (3.0, 0.5, 0.2),
        (3.0, 1.0, 0.1),
        (3.0, 0.5, 0.115),
        (22.0, 0.3, 1.0),
        (3.0, 5.0, 0.4),
        (3.0, 3.0, 0.0025),  # the edge is nearly straight
        (3.0, 2.98, 0.0025),
        (3.0, 3.01, 0.0025),
    ],
)
def test_tails_keep_their_digits(
    capture_um: float, bias_um: float, sigma_um: float
) -> None:
    wanted = marcum(bias_um / sigma_um, capture_um / sigma_um)
    found = miss_probability(fit(capture_um), NONE, sigma_um, bias_um)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_a_tail_of_a_hundred_zeros_is_not_rounded_away() -> None:
    sigma_um = 3.0 / math.sqrt(2 * math.log(1e100))
    found = miss_probability(fit(3.0), NONE, sigma_um)
    # exp of -230 keeps 13 of 16 digits
    assert found == pytest.approx(1e-100, rel=1e-11)
    assert miss_probability(fit(3.0), NONE, 0.9 * sigma_um, 0.1) > 0


def test_the_spread_that_a_clearance_allows() -> None:
    """Without bias and size spread s_max = r / sqrt(-2 ln(1 - P))."""
    for capture_um, s_max_um in ((3.0, 1.23), (0.5, 0.20)):
        exact_um = capture_um / math.sqrt(-2 * math.log(0.05))
        assert exact_um == pytest.approx(s_max_um, abs=0.005)
        found = miss_probability(fit(capture_um), NONE, exact_um)
        assert found == pytest.approx(0.05, rel=1e-12)


def test_the_papers_cell() -> None:
    """Looking down the bore 1.03 um, look-then-move 1.41 um; sizes vary by .3 um."""
    assert 1 - miss_probability(PAPER, NONE, 1.03) == pytest.approx(0.98, abs=0.005)
    assert 1 - miss_probability(PAPER, NONE, 1.41) == pytest.approx(0.89, abs=0.005)
    assert 1 - miss_probability(PAPER, NONE, 1.41 / 3) > 0.999


def test_without_spread_it_is_a_matter_of_geometry() -> None:
    assert miss_probability(fit(3.0), NONE, 0.0) == 0.0
    assert miss_probability(fit(3.0), NONE, 0.0, 2.999) == 0.0
    assert miss_probability(fit(3.0), NONE, 0.0, 3.0) == 1.0
    assert miss_probability(fit(3.0), NONE, 1e-200, 2.9) == 0.0
    assert miss_probability(fit(3.0), NONE, 1e-5, 3.0) == pytest.approx(0.5, abs=1e-5)
    assert miss_probability(fit(3.0), Residual(sigma_um=1.0, within_um=2.0), 0.0) == 0.0


@pytest.mark.parametrize("capture_um", [0.0, -1.0])
def test_without_clearance_nothing_goes_in(capture_um: float) -> None:
    assert miss_probability(fit(capture_um), NONE, 1.0) == 1.0
    assert miss_probability(fit(capture_um), NONE, 0.0) == 1.0


@pytest.mark.parametrize("capture_um", [1e-15, 8.7e-14, 1e-9, 1e-4, 1e-2])
@pytest.mark.parametrize("bias_um", [0.5, 1.0, 1.2])
def test_a_hole_of_no_room_is_always_missed(capture_um: float, bias_um: float) -> None:
    """16 to 39 sigmas off, the chance inside is below exp(-16**2 / 2) = 2e-56."""
    assert miss_probability(fit(capture_um), NONE, 0.03125, bias_um) == 1.0


lengths = st.floats(0.0, 20.0)


@settings(max_examples=40, deadline=None)
@example(
    capture_um=0.0, tolerance_um=0.5, sigma_um=0.0, bias_um=5e-324, move_um=1.0,
    within_um=0.125,
)  # fmt: skip
@given(
    capture_um=st.floats(-1, 20), tolerance_um=st.floats(0, 0.5), sigma_um=lengths,
    bias_um=lengths, move_um=lengths, within_um=lengths,
)  # fmt: skip
def test_a_chance_is_a_chance_and_grows_with_every_error(
    capture_um: float,
    tolerance_um: float,
    sigma_um: float,
    bias_um: float,
    move_um: float,
    within_um: float,
) -> None:
    found, residual = (
        fit(capture_um, tolerance_um),
        Residual(sigma_um=move_um, within_um=within_um),
    )
    p = miss_probability(found, residual, sigma_um, bias_um)
    assert -1e-12 <= p <= 1 + 1e-12
    assert miss_probability(found, residual, sigma_um, bias_um + 1) >= p - 1e-9
    roomier = fit(capture_um + 1, tolerance_um)
    assert miss_probability(roomier, residual, sigma_um, bias_um) <= p + 1e-9


@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.5])
def test_the_residual_is_a_cut_off_normal(ratio: float) -> None:
    residual = Residual(sigma_um=2.0, within_um=2.0 * ratio)
    radii, weights = residual.radii()
    assert weights.sum() == pytest.approx(1.0)
    assert radii.max() < residual.within_um
    q = ratio**2 / 2  # E r^2 of a Rayleigh law cut off at ratio sigmas
    wanted = 2 * 2.0**2 * (1 - q * math.exp(-q) / -math.expm1(-q))
    assert weights @ radii**2 == pytest.approx(wanted, rel=1e-9)


def run_servo(gain: float, within: float, runs: int) -> tuple[float, float]:
    """Return mean looks and mean squared radius at the end, in stage sigmas.

    A stage that repeats to n about its readings: e+ = (1 - g) e + n+ - n.
    """
    rng = np.random.default_rng(3)
    n = rng.normal(size=(runs, 2))
    error = n + rng.normal(size=(runs, 2)) * math.sqrt(gain / (2 - gain))
    looks, live = np.ones(runs), np.hypot(error[:, 0], error[:, 1]) >= within
    while live.any():
        fresh = rng.normal(size=(int(live.sum()), 2))
        error[live] = (1 - gain) * error[live] + fresh - n[live]
        n[live] = fresh
        looks[live] += 1
        live[live] = np.hypot(error[live, 0], error[live, 1]) >= within
    return float(looks.mean()), float((error**2).sum(axis=1).mean())


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("within", [0.6, 1.2, 2.0])
def test_expected_looks_and_residual_are_those_of_the_loop(
    gain: float, within: float
) -> None:
    """Successive errors are correlated, which the closed form leaves out.

    The correlation is -g / 2: most at gain 1, where a look inside follows one outside
    less often. It costs up to 7 percent of the looks and 3 of the squared residual.
    """
    residual = Residual(sigma_um=math.sqrt(2 / (2 - gain)), within_um=within)
    looks, square = run_servo(gain, within, 60_000)
    # 2 percent: five standard errors of a geometric mean over 60 000 runs
    assert 0.98 <= looks / expected_looks(residual) <= 1.09
    radii, weights = residual.radii()
    assert square == pytest.approx(float(weights @ radii**2), rel=0.04)


def test_a_servo_that_can_never_stop_takes_for_ever() -> None:
    assert expected_looks(Residual(sigma_um=1.0, within_um=0.0)) == math.inf
    assert expected_looks(Residual(sigma_um=0.0, within_um=1.0)) == 1.0
    assert expected_looks(Residual(sigma_um=1.0, within_um=0.6)) == pytest.approx(
        6.07, abs=0.005
    )


@given(
    capture_um=st.floats(0.3, 10), move_um=st.floats(0.1, 3), sigma_um=st.floats(0, 2)
)
@settings(max_examples=25, deadline=None)
def test_the_servo_tolerance_keeps_its_share_and_its_bounds(
    capture_um: float, move_um: float, sigma_um: float
) -> None:
    found, goal = fit(capture_um, 0.1), 0.95
    within = servo_tolerance_um(found, move_um, sigma_um, goal)
    ceiling = max(capture_um / 2, LEAST_SIGMAS * move_um)
    floor = min(EASY_SIGMAS * move_um, ceiling)
    assert floor * (1 - 1e-12) <= within <= ceiling * (1 + 1e-12)
    residual = Residual(sigma_um=move_um, within_um=within)
    if within > floor * (1 + 1e-9):
        miss = miss_probability(found, residual, sigma_um)
        assert miss <= SERVO_SHARE * (1 - goal)
    # more of what the servo cannot see, or a higher goal: never a looser tolerance
    assert servo_tolerance_um(found, move_um, sigma_um + 0.3, goal) <= within
    assert servo_tolerance_um(found, move_um, sigma_um, 0.999) <= within
    # more room: never a tighter one
    roomier = servo_tolerance_um(fit(capture_um + 1, 0.1), move_um, sigma_um, goal)
    assert roomier >= within - (capture_um + 1) / 2 / 32  # one step of the search


def test_errors_combine_in_quadrature() -> None:
    assert combine([3.0, 4.0]) == 5.0
    assert combine([]) == 0.0
