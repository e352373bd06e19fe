"""Twins against textbooks: areas, poses, transfer, energy, counts."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import j1
from shapely.geometry import Polygon

from validation import twins
from validation.twins.camera import Camera, Scene, picture
from validation.twins.raster import (
    Floats,
    Grid,
    Lens,
    Pose,
    blurred,
    coverage,
    transfer,
)

GRID = Grid(rows=120, columns=160, um_per_px=0.375)
LENS = Lens(aperture=0.42, wavelength_um=0.6)
QUIET = Camera(top=65535, gain=1.0, noise=((0.0, 0.0), (65535.0, 0.0)))


def star(points: int = 9) -> Floats:
    """Return a polygon without symmetry."""
    rng = np.random.default_rng(3)
    angle = np.sort(rng.uniform(0, 2 * np.pi, points))
    radius = rng.uniform(5, 14, points)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def circle(radius_um: float) -> Floats:
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    return radius_um * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def centroid_um(points: Floats) -> tuple[float, float]:
    x, y = GRID.axes_um()
    total = points.sum()
    return float((points @ x).sum() / total), float((y @ points).sum() / total)


def test_area_and_centroid_are_those_of_the_polygon() -> None:
    """With a hole, at any pose: conventions of x, y and angle included."""
    hole = np.array([(-1.0, -1.0), (1.5, -1.0), (1.5, 0.5), (-1.0, 0.5)])
    for pose in (Pose(), Pose(x_um=3.3, y_um=-2.1, theta_rad=0.7)):
        outer, inner = pose.apply(star()), pose.apply(hole)
        found = coverage([outer, inner], GRID)
        body = Polygon(outer, [inner])
        assert found.sum() * GRID.step_um**2 == pytest.approx(body.area, rel=2e-4)
        assert centroid_um(found) == pytest.approx(body.centroid.coords[0], abs=2e-3)
    assert Pose(theta_rad=math.pi / 2).apply(np.array([[1.0, 0.0]])) == pytest.approx(
        np.array([[0.0, 1.0]])
    )


def test_a_mark_lands_in_the_pixel_that_conventions_say() -> None:
    """Right of the middle and above it: a larger column, a smaller row."""
    square = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
    spot = coverage([square + (0.375 * 20.5, 0.375 * 10.5)], GRID)
    assert np.argwhere(GRID.pixels(spot) > 0).tolist() == [[49, 100]]


def test_the_transfer_in_focus_is_that_of_a_circular_pupil() -> None:
    """Goodman, Introduction to Fourier Optics, eq. (6-31): the common area of discs."""
    found = transfer(LENS, GRID)
    u = np.fft.fftfreq(GRID.columns * GRID.finer, GRID.step_um)
    x = np.abs(u) * LENS.wavelength_um / (2 * LENS.aperture)
    own = np.minimum(x, 1)
    wanted = 2 / np.pi * (np.arccos(own) - own * np.sqrt(1 - own**2))
    assert np.abs(found[0] - wanted).max() < 4e-3
    assert np.abs(found[0][x > 1.02]).max() < 1e-3


def test_the_first_zero_is_airy_s() -> None:
    """Where J1 is first zero, .61 wavelengths over the aperture."""
    assert abs(j1(3.8317)) < 1e-4
    fine = Grid(rows=64, columns=64, um_per_px=0.1, finer=1)
    point = np.zeros((64, 64))
    point[32, 32] = 1.0
    spread = blurred(point, LENS, fine)[32, 32:]
    first = int(np.argmax(np.diff(spread) > 0))
    assert first * 0.1 == pytest.approx(0.61 * 0.6 / 0.42, abs=0.1)


@pytest.mark.parametrize("waves", [{}, {"coma": 0.1}, {"spherical": 0.1}])
def test_defocus_and_aberrations_lose_no_light(waves: dict[str, float]) -> None:
    lens = Lens(aperture=0.42, wavelength_um=0.6, defocus_um=3.0, waves=waves)
    points = coverage([star()], GRID)
    assert blurred(points, lens, GRID).sum() == pytest.approx(points.sum(), rel=1e-6)


def test_only_odd_aberrations_move_a_disc() -> None:
    def at(**waves: float) -> tuple[float, float]:
        lens = Lens(aperture=0.42, wavelength_um=0.6, waves=waves)
        return centroid_um(blurred(coverage([circle(8.0)], GRID), lens, GRID))

    assert at() == pytest.approx((0, 0), abs=5e-3)
    assert at(spherical=0.1) == pytest.approx((0, 0), abs=5e-3)
    x, y = at(coma=0.1)
    assert abs(x) > 0.03
    assert y == pytest.approx(0, abs=5e-3)


def test_counts_have_the_response_the_cut_and_the_noise_that_are_stated() -> None:
    light = np.full((200, 200), 0.25)
    rng = np.random.default_rng(1)
    level = 255 * 0.25**0.5
    camera = Camera(gain=1.0, gamma=0.5, noise=((0.0, 1.0), (255.0, 5.0)))
    counts = camera.counts(light, rng)
    sigma = 1 + 4 * level / 255
    assert counts.mean() == pytest.approx(level, abs=0.05)
    assert counts.std() == pytest.approx(math.hypot(sigma, 12**-0.5), rel=0.02)
    black = Camera(black=-100.0, gain=1.0).counts(light, rng)
    assert (black == 0).mean() > 0.99
    assert Camera(gain=9.0).counts(light, rng).min() > 250


def test_halo_keeps_the_light_and_dust_takes_some() -> None:
    rng = np.random.default_rng(2)

    def total(scene: Scene) -> float:
        return float(picture(scene, Pose(), LENS, QUIET, GRID, rng).mean())

    bare = total(Scene(rings=[star()]))
    assert total(Scene(rings=[star()], halo=(0.2, 4.0))) == pytest.approx(bare, 2e-3)
    assert total(Scene(rings=[star()], dust=20)) < 0.999 * bare
    assert total(Scene(rings=[])) == pytest.approx(0.1 * 65535, rel=1e-4)


def test_twins_share_no_code_with_what_they_judge() -> None:
    for file in Path(twins.__file__).parent.parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [getattr(node, "module", None) or ""]
            if isinstance(node, ast.Import):
                names = [each.name for each in node.names]
            assert not any(each.startswith("microplan") for each in names), file
