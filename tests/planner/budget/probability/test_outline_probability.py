"""P(insert) of outlines, against draws, round fits and what must be exact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.compiling.outline_pairs import draw, draw_pair
from benchmarks.compiling.outline_shapes import (
    FAMILIES,
    box,
    chain,
    closed,
    d_shape,
    hollow,
)
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.ellipse_probability import PlaneNormal
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    RoundFit,
    miss_probability,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit, PoseError
from microplan.planner.budget.probability.outline_probability import seating
from microplan.planner.budget.probability.polygon_mass import PlaneError
from microplan.schemas.plan.verdicts import TurnRow

NONE = Residual(sigma_um=0.0, within_um=0.0)
DRAWS = 2000
SIZED = ("D", "L", "rectangle")  # the others as drawn: less to do
DEAREST = ("D", "L", "key", "cross")


def circle(radius: float) -> Outline:
    return chain(
        [Arc(center=(0, 0), radius_um=radius, start_rad=0, sweep_rad=math.tau)]
    )


def fit_of(hole: Outline, peg: Outline, tolerance: float = 0.0) -> OutlineFit:
    return OutlineFit(
        shape=PegInHole(hole=hollow(hole), peg=peg),
        hole_tolerance_um=tolerance,
        shaft_tolerance_um=tolerance,
    )


def error_of(
    sigma: float, turn: float = 0.0, residual: Residual = NONE, off: float = 0.0
) -> PoseError:
    rows = (TurnRow(term="angle", sigma_rad=turn, source="test"),)
    rest = PlaneNormal(middle_um=(off, 0.0), xx_um2=sigma**2, yy_um2=sigma**2)
    return PoseError(
        plane=PlaneError(residual=residual, rest=rest),
        angle=AngleError(left_rad=0.0, cut_rad=math.inf, rows=rows),
    )


@pytest.mark.parametrize(
    "family",
    [
        pytest.param(f, marks=[pytest.mark.slow] if f in DEAREST else [])
        for f in FAMILIES
        if f != "spline"
    ],
)
def test_chances_agree_with_draws(family: str) -> None:
    rng = np.random.default_rng(17)
    pair = draw_pair(family, rng)
    if family not in SIZED:
        pair = replace(pair, fit=pair.fit.scaled(0.0))
    found, drawn = seating(pair.fit, pair.error), draw(pair, DRAWS, rng, batches=20)
    assert found.seated + found.elsewhere + found.miss == pytest.approx(1, abs=1e-5)
    inside = found.seated + found.elsewhere
    for chance, share in ((found.seated, drawn.seated), (inside, drawn.inside)):
        spread = math.sqrt(max(chance * (1 - chance), 1 / DRAWS) / DRAWS)
        # the sizes of a batch are common to it: as if there were fewer draws
        assert abs(chance - share) < 4 * max(spread, drawn.inside_error)


@pytest.mark.parametrize("off", [0.0, 1.0])
@pytest.mark.parametrize("residual", [NONE, Residual(sigma_um=0.6, within_um=1.4)])
def test_circles_have_the_chance_of_a_round_fit(off: float, residual: Residual) -> None:
    found = seating(
        fit_of(circle(25.0), circle(22.0), 0.3),
        error_of(0.8, 0.1, residual=residual, off=off),
    )
    exact = miss_probability(
        RoundFit(
            hole_um=25, shaft_um=22, hole_tolerance_um=0.3, shaft_tolerance_um=0.3
        ),
        residual, 0.8, off,
    )  # fmt: skip
    # polygons of arcs: the room is right to 1e-3 of 3 um, a miss to 3 (3 / .8**2) 1e-3
    assert found.miss == pytest.approx(exact, rel=0.015)


def test_what_always_fits_does_and_what_never_does_not() -> None:
    keyed, key = d_shape(33.0, 20.0), d_shape(30.0, 17.0)
    narrow = error_of(0.01, 1e-4)
    assert seating(fit_of(keyed, key), narrow).miss < 1e-12
    # 53 um between the flat and the other side: no post of 60 um goes in, at any angle
    wide = error_of(5.0, math.pi)
    found = seating(fit_of(keyed, circle(30.0), 0.3), wide)
    assert (found.seated, found.elsewhere, found.miss) == (0.0, 0.0, 1.0)


@pytest.mark.parametrize("turn", [1e-8, 1e-9, 1e-11])
def test_an_angle_that_is_all_but_exact_is_as_good_as_exact(turn: float) -> None:
    fit = fit_of(box(40, 11), box(30, 10))
    exact = seating(fit, error_of(0.3)).miss
    # 1e-8 rad at 32 um of 1 um: a miss changes by 3e-7 / .3**2 of itself
    assert seating(fit, error_of(0.3, turn)).miss == pytest.approx(exact, rel=1e-5)


def known_angle(error: PoseError, off: float) -> PoseError:
    """Return the error where the angle is known to be `off` from its middle."""
    rest, (arm_x, arm_y) = error.plane.rest, error.lever_um
    x, y = rest.middle_um
    moved = replace(rest, middle_um=(x + off * arm_x, y + off * arm_y))
    return PoseError(
        plane=replace(error.plane, rest=moved),
        angle=AngleError(left_rad=0.0, cut_rad=math.inf, rows=()),
        middle_rad=error.middle_rad + off,
    )


@pytest.mark.parametrize("turn", [1e-4, 3e-3, 0.03])
def test_an_angles_error_averages_over_known_angles(turn: float) -> None:
    """By the rule of equal steps, blind to where slices appear: 1e-4 of them."""
    fit = fit_of(d_shape(25.0, 16.0), d_shape(23.5, 14.5))
    error = replace(
        error_of(0.4, turn, residual=Residual(sigma_um=0.6, within_um=0.8)),
        lever_um=(20.0, -9.0),
        middle_rad=2e-3,
    )
    steps = np.linspace(-7, 7, 281)
    weights = np.exp(-(steps**2) / 2) / np.exp(-(steps**2) / 2).sum()
    known = [seating(fit, known_angle(error, turn * step)).miss for step in steps]
    assert seating(fit, error).miss == pytest.approx(
        float(weights @ np.array(known)), rel=1e-4
    )


def test_a_closer_probability_is_the_same_to_what_was_asked() -> None:
    fit = fit_of(box(40, 11), box(38, 10), 0.2)
    for turn in (1e-3, 0.02, 0.3):
        error = error_of(0.5, turn)
        exact = seating(replace(fit, close=1e-6), error)
        for close in (1e-3, 1e-4):
            found = seating(replace(fit, close=close), error)
            rarer = min(exact.miss, 1 - exact.miss)
            assert abs(found.miss - exact.miss) < close * rarer


def test_other_pieces_do_not_count_as_seated() -> None:
    found = seating(fit_of(box(11, 11), box(10, 10)), error_of(0.2, math.pi))
    # a square goes in at four angles
    assert found.elsewhere == pytest.approx(3 * found.seated, rel=1e-3)


def test_a_lever_that_makes_up_for_the_angle_helps() -> None:
    """A long bar turned about its end stays in if its middle is moved along."""
    bar = closed([(0, -1), (40, -1), (40, 1), (0, 1)])
    hole = closed([(-9, -1.5), (49, -1.5), (49, 1.5), (-9, 1.5)])
    fit, error = fit_of(hole, bar), error_of(0.05, 0.015)
    freely = seating(fit, error).seated
    held = seating(fit, replace(error, lever_um=(0.0, -20.0))).seated
    against = seating(fit, replace(error, lever_um=(0.0, 20.0))).seated
    assert held > freely + 0.2 > against + 0.3


def test_the_capture_radius_is_the_nearest_wall() -> None:
    fit = fit_of(box(11, 12), box(10, 10))
    assert fit.capture_um == pytest.approx(1.0)
    assert fit.widened(0.5).capture_um == pytest.approx(1.5)
    assert fit_of(box(9, 9), box(10, 10)).capture_um == 0.0
