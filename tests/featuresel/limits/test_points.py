from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.featuresel.limits.information import covariance, limit
from microplan.featuresel.limits.points import across, pose_information
from microplan.optics.lens.jacobian import to_px
from microplan.optics.transfer.microscope import Microscope

SCOPE = Microscope(
    aperture=0.42, wavelength_um=0.6, medium_index=1.0, magnification=7.5,
    pitch_um=7.5, width_px=641, height_px=481,
)  # fmt: skip
SIGMA = 0.1


def seen(*points_um: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return pixels of points, each known to `SIGMA` both ways."""
    pixels = to_px(np.array(points_um, dtype=np.float64), SCOPE)
    return pixels, np.broadcast_to(np.eye(2) / SIGMA**2, (len(points_um), 2, 2))


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(3, 6),
)
def test_covariance_is_that_of_fitted_poses(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-80, 80, (count, 2))
    pixels, precision = seen(*map(tuple, points))
    x, y, theta, zoom = 1e-4, -2e-4, 3e-6, 4e-6
    turn = np.array([[0, -theta], [theta, 0]])
    moved = points + points @ turn.T + (x, y) + zoom * points
    off = (to_px(moved, SCOPE) - pixels).ravel()
    names = ("x", "y", "theta", "zoom")
    found = pose_information(pixels, precision, SCOPE, names=names)
    # weighted least squares by another road: a fit of the similarity's four numbers
    zeros, ones = np.zeros(count), np.ones(count)
    k = SCOPE.px_per_um
    rows = np.stack(
        [
            np.stack([ones, zeros, -points[:, 1], points[:, 0]], axis=1) * k,
            np.stack([zeros, -ones, -points[:, 0], -points[:, 1]], axis=1) * k,
        ],
        axis=1,
    ).reshape(-1, 4)
    fit = np.linalg.lstsq(rows, off, rcond=None)[0]
    np.testing.assert_allclose(fit, (x, y, theta, zoom), rtol=1e-4, atol=1e-10)
    expected = SIGMA**2 * np.linalg.inv(rows.T @ rows)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(covariance(found) / scale, expected / scale, atol=1e-6)


def test_one_point_on_the_axis_tells_its_place_alone() -> None:
    found = limit(pose_information(*seen((0.0, 0.0)), SCOPE))
    assert found["x"] == found["y"] == pytest.approx(SIGMA)
    assert found["theta"] == math.inf


def test_one_point_off_the_axis_cannot_tell_a_turn_from_a_shift() -> None:
    found = limit(pose_information(*seen((50.0, 0.0)), SCOPE))
    assert found["x"] == pytest.approx(SIGMA)
    assert found["y"] == found["theta"] == math.inf


def test_coincident_points_are_one_point() -> None:
    found = limit(pose_information(*seen((50.0, 20.0), (50.0, 20.0)), SCOPE))
    assert set(found.values()) == {math.inf}
    apart = limit(pose_information(*seen((50.0, 20.0), (50.0, 21.0)), SCOPE))
    # the turn is told over 1 um alone, by a difference of two errors
    assert apart["theta"] == pytest.approx(math.sqrt(2) * SIGMA, rel=0.01)


def test_collinear_points_tell_all_of_the_pose() -> None:
    found = limit(pose_information(*seen((-30.0, 0.0), (0.0, 0.0), (30.0, 0.0)), SCOPE))
    assert found["x"] == found["y"] == pytest.approx(SIGMA / math.sqrt(3))
    assert found["theta"] == pytest.approx(SIGMA / math.sqrt(1800))


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.3])
def test_collinear_points_of_one_edge_do_not_tell_along_it(angle: float) -> None:
    along = np.array([-math.sin(angle), math.cos(angle)])
    points = [tuple(20 * s * along) for s in (-1.0, 0.0, 1.0)]
    pixels, _ = seen(*points)
    precision = np.stack([across(angle, SIGMA)] * 3)
    found = limit(pose_information(pixels, precision, SCOPE))
    assert (found["x"] < math.inf) == (angle == 0.0)
    assert (found["y"] < math.inf) == (angle == math.pi / 2)
    assert found["theta"] == pytest.approx(SIGMA / math.sqrt(800))


def test_parallel_edges_do_not_tell_along_them_and_a_third_does() -> None:
    pixels, _ = seen((-20.0, 0.0), (20.0, 0.0), (0.0, 20.0))
    pair = np.stack([across(math.pi, SIGMA), across(0.0, SIGMA)])
    found = limit(pose_information(pixels[:2], pair, SCOPE, names=("x", "y")))
    assert found == {"x": pytest.approx(SIGMA / math.sqrt(2)), "y": math.inf}
    three = np.concatenate((pair, across(math.pi / 2, SIGMA)[None]))
    found = limit(pose_information(pixels, three, SCOPE, names=("x", "y")))
    assert found["y"] == pytest.approx(SIGMA)


def test_no_points_tell_nothing() -> None:
    found = pose_information(np.zeros((0, 2)), np.zeros((0, 2, 2)), SCOPE)
    assert limit(found) == {"x": math.inf, "y": math.inf, "theta": math.inf}


def test_what_is_no_covariance_is_refused() -> None:
    pixels, precision = seen((0.0, 0.0))
    with pytest.raises(ValueError, match="z"):
        pose_information(pixels, precision, SCOPE, names=("x", "z"))
    with pytest.raises(ValueError, match="precision must be"):
        pose_information(pixels, np.ones((2, 2)), SCOPE)
    for bad in ([[1.0, 0.5], [0.0, 1.0]], [[1.0, 0.0], [0.0, -1.0]]):
        with pytest.raises(ValueError, match="symmetric"):
            pose_information(pixels, np.array([bad]), SCOPE)
    with pytest.raises(ValueError, match="sigma_px"):
        across(0.0, 0.0)
