"""Mass of an error in polygons, against closed forms and draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy import stats
from shapely.geometry import Polygon

from microplan.planner.assembly.fits.peg_in_hole import edges_of
from microplan.planner.budget.probability.ellipse_probability import (
    PlaneNormal,
    beyond_circle,
)
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    RoundFit,
    miss_probability,
)
from microplan.planner.budget.probability.polygon_mass import PlaneError, masses

NONE = Residual(sigma_um=0.0, within_um=0.0)
NO_SHIFT = np.zeros((1, 2))


def disc(radius: float, count: int = 4000) -> Polygon:
    """Return a polygon as large as a disc."""
    turn = np.arange(count) / count * math.tau
    grown = radius * math.sqrt(math.tau / count / math.sin(math.tau / count))
    return Polygon(grown * np.column_stack([np.cos(turn), np.sin(turn)]))


@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.7, -0.2), (1.0, 0.5), (9.0, 3.0)])
@pytest.mark.parametrize("sigmas", [(0.3, 0.4), (1.0, 0.02), (2.0, 5.0)])
def test_a_box_is_a_product_of_two_intervals(
    middle: tuple[float, float], sigmas: tuple[float, float]
) -> None:
    rest = PlaneNormal(middle_um=middle, xx_um2=sigmas[0] ** 2, yy_um2=sigmas[1] ** 2)
    box = shapely.box(-1.0, -0.5, 1.0, 0.5)
    hit, miss = masses(edges_of([box]), PlaneError(residual=NONE, rest=rest), NO_SHIFT)
    sides = [
        stats.norm.cdf((half - m) / s) - stats.norm.cdf((-half - m) / s)
        for half, m, s in zip((1.0, 0.5), middle, sigmas, strict=True)
    ]
    # the table of the tail is linear over 1.5e-3 sigma: 3e-7 of it
    assert hit[0] == pytest.approx(math.prod(sides), rel=1e-5, abs=1e-12)
    assert hit[0] + miss[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("off", [0.0, 1e-15, -1e-15, 1e-10])
@pytest.mark.parametrize(("x", "share"), [(0.0, 0.5), (10.0, 0.25)])
@pytest.mark.parametrize("sigma_y", [0.3, 0.2])
def test_half_is_inside_where_an_edge_goes_through_the_middle(
    off: float, x: float, share: float, sigma_y: float
) -> None:
    rest = PlaneNormal(middle_um=(x, 1.0 + off), xx_um2=0.09, yy_um2=sigma_y**2)
    error = PlaneError(residual=NONE, rest=rest)
    hit, miss = masses(edges_of([shapely.box(-10, -1, 10, 1)]), error, NO_SHIFT)
    # moved by 1e-8 sigma at most
    assert (hit[0], miss[0]) == pytest.approx((share, 1 - share), abs=1e-7)


def test_tails_of_an_ellipse_keep_their_digits() -> None:
    rest = PlaneNormal.along(0.3, None).plus(PlaneNormal.along(0.2, 1.0))
    _, miss = masses(
        edges_of([disc(3.0)]), PlaneError(residual=NONE, rest=rest), NO_SHIFT
    )
    exact = beyond_circle(3.0, rest)
    assert exact < 1e-13
    assert miss[0] == pytest.approx(exact, rel=2e-3)  # 4000 chords


@pytest.mark.parametrize(("sigma", "within"), [(0.6, 1.4), (3.0, 1.0), (0.2, 2.0)])
@pytest.mark.parametrize(("rest_um", "bias"), [(0.5, 0.0), (0.1, 0.4), (2.0, 1.0)])
def test_a_cut_off_residual_in_a_disc_is_that_of_a_round_fit(
    sigma: float, within: float, rest_um: float, bias: float
) -> None:
    residual = Residual(sigma_um=sigma, within_um=within)
    fit = RoundFit(hole_um=4.0, shaft_um=2.0, hole_tolerance_um=0, shaft_tolerance_um=0)
    rest = PlaneNormal(middle_um=(0.0, bias), xx_um2=rest_um**2, yy_um2=rest_um**2)
    error = PlaneError(residual=residual, rest=rest)
    _, miss = masses(edges_of([disc(2.0)]), error, NO_SHIFT)
    assert miss[0] == pytest.approx(
        miss_probability(fit, residual, rest_um, bias), rel=2e-3, abs=1e-7
    )


def test_pieces_and_holes_add_up() -> None:
    body = Polygon(
        [(-2, -2), (3, -2), (3, 2), (-2, 2)], [[(-1, -1), (-1, 1), (1, 1), (1, -1)]]
    )
    parts = [shapely.box(-2, -2, 3, 2), shapely.box(-1, -1, 1, 1)]
    rest = PlaneNormal(middle_um=(0.3, 0.1), xx_um2=1.0, xy_um2=0.4, yy_um2=0.5)
    error = PlaneError(residual=Residual(sigma_um=0.5, within_um=0.7), rest=rest)
    hit, _ = masses(edges_of([body, *parts]), error, np.zeros((3, 2)))
    assert hit[0] == pytest.approx(hit[1] - hit[2], abs=1e-7)


def test_leaning_errors_beside_a_cut_off_agree_with_draws() -> None:
    rng = np.random.default_rng(3)
    rest = PlaneNormal.along(0.1, None).plus(PlaneNormal.along(0.8, 0.6))
    error = PlaneError(residual=Residual(sigma_um=1.0, within_um=0.8), rest=rest)
    body = Polygon([(-1, -1), (1.5, -0.5), (0.8, 1.2), (0.2, 0.1)])
    hit, _ = masses(edges_of([body]), error, NO_SHIFT)
    count = 400_000
    left = rng.normal(0, 1.0, (3 * count, 2))
    left = left[np.hypot(*left.T) < 0.8][:count]
    count = len(left)
    way = np.array([math.cos(0.6), math.sin(0.6)])
    drawn = left + rng.normal(0, 0.1, (count, 2)) + rng.normal(0, 0.8, (count, 1)) * way
    share = shapely.contains_xy(body, *drawn.T).mean()
    assert abs(hit[0] - share) < 4 * math.sqrt(share * (1 - share) / count)
