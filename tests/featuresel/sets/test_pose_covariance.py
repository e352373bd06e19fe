"""What measured features tell of a pose, by two roads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.featuresel.sets.pose_covariance import (
    FINEST_UM,
    FeatureMeasurement,
    conditioning,
    controllability,
    covariance,
    information,
    jacobian,
)


def point(x: float, y: float, sigma: float = 0.1) -> FeatureMeasurement:
    return FeatureMeasurement(name=f"{x:g},{y:g}", x_um=x, y_um=y, sigma_um=sigma)


def edge(x: float, y: float, axis: float, sigma: float = 0.1) -> FeatureMeasurement:
    return replace(point(x, y, sigma), name=f"{x:g},{y:g},{axis:g}", axis_rad=axis)


def test_the_jacobian_is_how_places_move() -> None:
    measured = [point(30, -20), edge(-40, 10, 0.7)]
    radius, step = 50.0, 1e-6

    def seen(x: float, y: float, theta: float) -> list[float]:
        c, s = math.cos(theta), math.sin(theta)
        at = [(c * k.x_um - s * k.y_um + x, s * k.x_um + c * k.y_um + y)
              for k in measured]  # fmt: skip
        along = math.cos(0.7) * at[1][0] + math.sin(0.7) * at[1][1]
        return [*at[0], along]

    moves = ((step, 0, 0), (0, step, 0), (0, 0, step / radius))
    columns = [
        (np.array(seen(*move)) - seen(*(-m for m in move))) / (2 * step)
        for move in moves
    ]
    np.testing.assert_allclose(
        jacobian(measured, radius), np.transpose(columns), atol=1e-8
    )


def test_the_covariance_is_that_of_points_in_pixels() -> None:
    rng = np.random.default_rng(3)
    k, radius = 0.92, 50.0  # px per um
    for _ in range(20):
        xy = rng.uniform(-50, 50, (5, 2))
        sigma = rng.uniform(0.01, 1.0, 5)
        axes = [None, None, None, *rng.uniform(-3, 3, 2)]
        measured, total = [], np.zeros((3, 3))
        for (x, y), s, axis in zip(xy, sigma, axes, strict=True):
            measured.append(replace(point(x, y, s), axis_rad=axis))
            weight = np.eye(2)
            if axis is not None:  # rows go down
                normal = np.array([math.cos(axis), -math.sin(axis)])
                weight = np.outer(normal, normal)
            moves = k * np.array([[1, 0, -y / radius], [0, -1, -x / radius]])
            total += moves.T @ weight @ moves / (s * k) ** 2
        expected = np.linalg.inv(total)
        np.testing.assert_allclose(covariance(measured, radius), expected, rtol=1e-8)


def test_the_covariance_is_that_of_fits_to_noisy_places() -> None:
    measured = [point(30, -20, 0.1), edge(-40, 10, 0.7, 0.05), point(5, 45, 0.2)]
    radius = 50.0
    sigmas = np.array([0.1, 0.1, 0.05, 0.2, 0.2])
    rows = jacobian(measured, radius)
    rng, draws = np.random.default_rng(1), 20_000
    noise = rng.standard_normal((draws, 5))  # in units of each spread
    fits = np.linalg.lstsq(rows / sigmas[:, None], noise.T, rcond=None)[0]
    # a variance of n draws is known to sqrt(2 / n) = 1 %; four times that
    np.testing.assert_allclose(
        np.cov(fits), covariance(measured, radius), rtol=0.04, atol=1e-4
    )


def test_one_point_tells_its_place_and_no_angle() -> None:
    found = covariance([point(0, 0, 0.3)], 50.0)
    np.testing.assert_allclose(np.diag(found), [0.09, 0.09, math.inf])
    # off the reference point the angle spoils the place across the arm
    found = covariance([point(40, 0, 0.3)], 50.0)
    assert found[0, 0] == pytest.approx(0.09)
    assert np.isinf(np.diag(found)[1:]).all()
    assert not np.isnan(found).any()


def test_coincident_points_are_one_better_point() -> None:
    found = covariance([point(0, 0, 0.3)] * 9, 50.0)
    np.testing.assert_allclose(np.diag(found), [0.01, 0.01, math.inf])
    assert conditioning([point(3, 4)] * 9, 50.0, angle=True) == math.inf
    assert controllability([point(3, 4)] * 9, 50.0, angle=True) == (2, 0.0)


def test_collinear_points_tell_everything_but_collinear_edges_do_not() -> None:
    line = [point(x, 2 * x) for x in (-20, 0, 20)]
    assert np.isfinite(covariance(line, 50.0)).all()
    assert controllability(line, 50.0, angle=True)[0] == 3
    along = [edge(x, 2 * x, math.atan2(-1, 2)) for x in (-20, 0, 20)]
    assert controllability(along, 50.0, angle=True)[0] == 2


def test_parallel_edges_tell_one_direction_and_the_angle() -> None:
    edges = [edge(0, y, 0.0) for y in (-30, 0, 30)]
    found = covariance(edges, 50.0)
    assert math.isinf(found[1, 1])
    assert found[0, 0] == pytest.approx(0.01 / 3)
    assert found[2, 2] == pytest.approx(0.01 / (2 * 0.36))
    assert (found[1, [0, 2]] == 0).all()


def test_an_own_angle_counts() -> None:
    turned = replace(point(0, 0, 0.1), sigma_theta_rad=0.002)
    found = covariance([turned], 50.0)
    np.testing.assert_allclose(np.diag(found), [0.01, 0.01, 0.01])
    assert conditioning([turned], 50.0, angle=True) == pytest.approx(1)


def test_extreme_spreads_are_finite_knowledge_or_none() -> None:
    blind = point(10, 0, math.inf)
    assert not information([blind], 50.0).any()
    assert jacobian([blind], 50.0).shape == (0, 3)
    assert np.isinf(np.diag(covariance([blind], 50.0))).all()
    exact = [point(-30, 0, 0.0), point(30, 0, 0.0), point(0, 30, 1.0)]
    found = covariance(exact, 50.0)
    assert found[0, 0] == pytest.approx(FINEST_UM**2 / 2, rel=1e-3)
    assert np.isfinite(found).all()
    mixed = covariance([point(0, 0, 0.0), point(30, 0, 100.0)], 50.0)
    assert mixed[2, 2] == pytest.approx((100 / 0.6) ** 2, rel=1e-3)


@given(
    first=st.floats(-9, 6),
    second=st.floats(-9, 6),
    axis=st.floats(0.3, 2.8),
    x=st.floats(-40, 40),
)
def test_spreads_far_apart_have_a_covariance(
    first: float, second: float, axis: float, x: float
) -> None:
    measured = [
        replace(edge(x, 5, 0.0, 10.0**first), sigma_theta_rad=10.0**second),
        edge(-x, 20, axis, 10.0**second),
    ]
    found = covariance(measured, 50.0)
    assert (np.diag(found) > 0).all()
    assert np.isfinite(found).all()
    # three rows for three unknowns: only the angle's own tells it; rounding by 2e-16
    # of the smallest spread's inverse is 1e-4 of the largest's, 5e11 times as far
    sigma = max(50.0 * 10.0**second, FINEST_UM)
    assert found[2, 2] == pytest.approx(sigma**2, rel=0.01)


def test_nonsense_is_an_error() -> None:
    with pytest.raises(ValueError, match="spreads"):
        point(0, 0, math.nan)
    with pytest.raises(ValueError, match="spreads"):
        point(0, 0, -1.0)
    with pytest.raises(ValueError, match="finite"):
        point(math.inf, 0)
    with pytest.raises(ValueError, match="radius_um"):
        jacobian([point(0, 0)], 0.0)
