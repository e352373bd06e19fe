"""Several features to one pose: exact places, weights, doubt, and what is not told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.stats import chi2

from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import (
    Believed,
    Fused,
    SeenFeature,
    bound,
    fuse,
)
from microplan.featuresel.sets.pose_covariance import FeatureMeasurement, covariance

TRUE = (412.0, -77.0, 0.4)


def seen(
    x: float, y: float, sigma: float = 0.1, *, at: tuple[float, float, float] = TRUE
) -> SeenFeature:
    """Return the feature at (x, y) of a part at `at`, seen without an error."""
    c, s = math.cos(at[2]), math.sin(at[2])
    return SeenFeature(
        x_um=at[0] + c * x - s * y,
        y_um=at[1] + s * x + c * y,
        sigma_um=sigma,
        offset_um=(x, y),
    )


def sure(sigma_rad: float = 1e-3) -> Believed:
    return Believed(theta_rad=TRUE[2], sigma_rad=sigma_rad)


def pose(found: Fused | Failure) -> tuple[float, float, float]:
    assert isinstance(found, Fused), found
    assert found.theta_rad is not None
    return found.x_um, found.y_um, found.theta_rad


@given(
    st.floats(-500, 500), st.floats(-500, 500), st.floats(-math.pi, math.pi),
    st.floats(20, 300),
)  # fmt: skip
def test_two_places_give_back_any_pose(
    x: float, y: float, theta: float, far: float
) -> None:
    at = (x, y, theta)
    found = pose(fuse([seen(far, 5.0, at=at), seen(-far, 20.0, at=at)]))
    assert found[:2] == pytest.approx((x, y), abs=1e-8)
    assert math.remainder(found[2] - theta, math.tau) == pytest.approx(0.0, abs=1e-10)


def test_one_feature_at_the_point_is_the_point() -> None:
    found = fuse([SeenFeature(x_um=3.25, y_um=-8.5, sigma_um=0.2)])
    assert isinstance(found, Fused)
    assert (found.x_um, found.y_um, found.theta_rad) == (3.25, -8.5, None)
    assert found.freedom == 0


def test_weighted_as_a_general_solver_does() -> None:
    rng = np.random.default_rng(3)
    some = [seen(80, 0, 0.05), seen(-60, 40, 0.3), seen(0, -90, 0.1)]
    some = [
        replace(s, x_um=s.x_um + s.sigma_um * a, y_um=s.y_um + s.sigma_um * b)
        for s, (a, b) in zip(some, rng.standard_normal((3, 2)), strict=True)
    ]
    edge = replace(seen(70, 70, 0.02), axis_rad=0.9)
    turned = replace(seen(10, 10, 5.0), theta_rad=TRUE[2] + 0.01, sigma_theta_rad=0.002)

    def off(p: np.ndarray) -> list[float]:
        found = []
        for s in (*some, edge, turned):
            x, y = s.offset_um
            ex = p[0] + math.cos(p[2]) * x - math.sin(p[2]) * y - s.x_um
            ey = p[1] + math.sin(p[2]) * x + math.cos(p[2]) * y - s.y_um
            if s.axis_rad is None:
                found += [ex / s.sigma_um, ey / s.sigma_um]
            else:
                along = math.cos(s.axis_rad) * ex + math.sin(s.axis_rad) * ey
                found.append(along / s.sigma_um)
            if s.theta_rad is not None and s.sigma_theta_rad is not None:
                found.append((p[2] - s.theta_rad) / s.sigma_theta_rad)
        return found

    best = least_squares(off, np.array(TRUE), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert pose(fuse([*some, edge, turned])) == pytest.approx(tuple(best.x), abs=1e-6)


def test_three_edges_are_enough_and_two_are_not() -> None:
    edges = [
        replace(seen(x, y), axis_rad=axis + TRUE[2])
        for x, y, axis in ((50, 0, 0.0), (0, 30, math.pi / 2), (-40, 30, math.pi / 2))
    ]
    assert pose(
        fuse(edges, Believed(theta_rad=TRUE[2] + 0.05, sigma_rad=0.1))
    ) == pytest.approx(TRUE, abs=1e-9)
    found = fuse(edges[1:2], sure())
    assert isinstance(found, Failure)
    assert found.code == "under_determined"


def test_an_angle_that_nobody_knows_is_said() -> None:
    found = fuse([seen(50, 0)])
    assert isinstance(found, Failure)
    assert found.code == "no_angle"
    believed = fuse([seen(50, 0)], sure())
    assert isinstance(believed, Fused)
    assert (believed.x_um, believed.y_um) == pytest.approx(TRUE[:2], abs=1e-9)
    assert believed.theta_rad is None  # it was believed, not told


def test_features_that_do_not_fit_one_pose_are_refused() -> None:
    some = [seen(80, 0), seen(-80, 0), seen(0, 80)]
    wrong = replace(some[2], y_um=some[2].y_um + 2.0)  # of a sigma of .1
    found = fuse([*some[:2], wrong])
    assert isinstance(found, Failure)
    assert found.code == "features_disagree"


@pytest.mark.parametrize("freedom", [1, 2, 3, 6, 12])
def test_the_bound_is_that_of_chi_square(freedom: int) -> None:
    # their approximation is on the careful side, at one degree of freedom by half
    assert 0.5e-4 < chi2.sf(bound(freedom), freedom) < 1e-4


def test_the_spread_is_what_the_search_for_sets_predicts() -> None:
    rng = np.random.default_rng(11)
    places = [(80.0, 0.0, 0.05), (-60.0, 40.0, 0.2), (0.0, -90.0, 0.1)]
    exact = [seen(*place) for place in places]
    found = []
    for _ in range(2000):
        noise = rng.standard_normal((3, 2))
        shown = [
            replace(s, x_um=s.x_um + s.sigma_um * a, y_um=s.y_um + s.sigma_um * b)
            for s, (a, b) in zip(exact, noise, strict=True)
        ]
        found.append(pose(fuse(shown)))
    c, s = math.cos(TRUE[2]), math.sin(TRUE[2])
    sights = [
        FeatureMeasurement(
            name=str(k), x_um=c * x - s * y, y_um=s * x + c * y, sigma_um=sigma
        )
        for k, (x, y, sigma) in enumerate(places)
    ]
    known = covariance(sights, 1.0)
    seen_cov = np.cov(np.array(found).T)
    # a variance of 2000 draws is off by 3.2 % (1 sigma)
    assert np.diag(seen_cov) == pytest.approx(np.diag(known), rel=0.13)


@pytest.mark.parametrize("arm_um", [0.0, 1e-15, 1e-6, 1e-3])
@pytest.mark.parametrize("believed", [None, sure()])
def test_hardly_any_arm_tells_no_angle(
    arm_um: float, believed: Believed | None
) -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        a, b, c, d = 0.1 * rng.standard_normal(4)
        first = SeenFeature(x_um=a, y_um=b, sigma_um=0.1)
        second = SeenFeature(x_um=c, y_um=d, sigma_um=0.1, offset_um=(arm_um, -arm_um))
        found = fuse([first, second], believed)
        assert isinstance(found, Fused)
        assert found.theta_rad is None
        # the mean of two, but for the arm's own length
        near = math.hypot(found.x_um - (a + c) / 2, found.y_um - (b + d) / 2)
        assert near <= arm_um + 1e-9


def test_an_angle_that_is_known_better_is_not_given_up_for_a_short_arm() -> None:
    some = [seen(0, 0), seen(8, 0)]  # tell it to .1 sqrt(2) / 8 rad
    told = fuse(some, sure(0.1))
    assert isinstance(told, Fused)
    assert told.sigma_theta_rad == pytest.approx(0.1 * math.sqrt(2) / 8)
    kept = fuse(some, sure(1e-3))
    assert isinstance(kept, Fused)
    assert kept.theta_rad is None
    again = fuse(some, sure(told.sigma_theta_rad or 0.0))
    assert isinstance(again, Fused)
    assert again.theta_rad is not None


def test_no_feature_is_no_pose() -> None:
    found = fuse([])
    assert isinstance(found, Failure)
