"""Circles through good and bad points, judged by scikit-image's RANSAC."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.measure import CircleModel, ransac

from microplan.featuresel.routines.circle.circle_fit import fit_centre, fit_circle

CENTRE, RADIUS = (31.3, 27.8), 23.0


def points(
    noise_px: float, wrong: int, seed: int = 4
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    radii = RADIUS + noise_px * rng.standard_normal(120)
    bad = np.zeros(120, dtype=bool)
    bad[:wrong] = True  # side by side, as a notch is
    radii[bad] += 5
    return CENTRE[0] + radii * np.cos(angles), CENTRE[1] + radii * np.sin(angles), bad


def test_exact_points_give_the_exact_circle() -> None:
    x, y, _ = points(0.0, 0)
    circle = fit_circle(x, y, (30, 30, 20))
    assert (circle.column, circle.row) == pytest.approx(CENTRE, abs=1e-9)
    assert circle.radius_px == pytest.approx(RADIUS, abs=1e-9)
    assert circle.used.all()


def test_a_notch_is_trimmed_and_does_not_move_the_centre() -> None:
    x, y, bad = points(0.05, 12)
    circle = fit_circle(x, y, (30, 30, 23))
    assert not circle.used[bad].any()
    # 108 of 120 points, .05 px each: standard error .05 sqrt(2 / 108), four of them
    limit = 4 * 0.05 * np.sqrt(2 / 108)
    assert np.hypot(circle.column - CENTRE[0], circle.row - CENTRE[1]) < limit
    assert circle.spread_px == pytest.approx(0.05 * np.sqrt(2 / 108), rel=0.3)


def test_it_agrees_with_ransac() -> None:
    x, y, bad = points(0.05, 25)
    circle = fit_circle(x, y, (30, 30, 23))
    model, inliers = ransac(  # type: ignore[no-untyped-call] # skimage
        np.column_stack((x, y)), CircleModel, 3, 0.2, max_trials=200, rng=1
    )
    xc, yc = model.center
    assert not inliers[bad].any()
    # both fit the same good points; RANSAC's band keeps a few more
    assert np.hypot(circle.column - xc, circle.row - yc) < 0.02


@pytest.mark.parametrize("start", [(20.0, 20.0), (43.0, 30.0), (31.0, 14.0)])
def test_known_radius_pulls_in_from_fourteen_pixels(start: tuple[float, float]) -> None:
    x, y, _ = points(0.05, 25)
    column, row = fit_centre(x, y, RADIUS, start)
    assert np.hypot(column - CENTRE[0], row - CENTRE[1]) < 0.5
