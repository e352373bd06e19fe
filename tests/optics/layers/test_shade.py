"""Shade by rays against closed forms, and a post seen through a bore."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.rays import Grid
from microplan.optics.layers.shade import light_share
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer, Scene
from tests.optics.bore import bore_aperture, bore_brightness
from tests.optics.shapes import circle, disc, microscope, rectangle

# n points of a spiral count an area to a rim's share: some 1 / n + 1 cell of the rim
SAMPLES = 2000


def plate(radius_um: float, half_um: float = 250.0) -> Outline:
    """Return a square plate with a round bore."""
    outer = rectangle(-half_um, -half_um, half_um, half_um).rings
    return Outline(rings=(*outer, circle(radius_um, hole=True)))


def over(outline: Outline, z_um: float) -> Layer:
    """Return a dark body at a height."""
    return Layer(name="over", outline=outline, z_um=z_um, reflectance=0.0)


def middle(count: int = 21, step_um: float = 0.5) -> Grid:
    """Return cells about the axis."""
    half = count * step_um / 2
    return Grid(left_um=-half, top_um=half, step_um=step_um, shape=(count, count))


@pytest.mark.parametrize(("radius_um", "depth_um"), [(25.0, 100.0), (25.0, 60.0)])
def test_the_floor_of_a_bore_gets_the_share_of_the_closed_form(
    radius_um: float, depth_um: float
) -> None:
    optics = microscope()
    found = light_share(
        (over(plate(radius_um), depth_um),), optics, middle(), 0.0, samples=SAMPLES
    )
    expected = bore_brightness(radius_um, depth_um, optics)
    # the rim lies within half a cell of .5 um, hence (R +- h / 2)**2
    assert abs(found[10, 10] - expected) < expected * 0.5 / radius_um
    assert found[10, 10] < 1


def test_a_wide_bore_throws_no_shade() -> None:
    optics = microscope()
    found = light_share((over(plate(80.0), 100.0),), optics, middle(), 0.0)
    assert np.all(found == 1)
    assert bore_brightness(1e9, 100.0, optics) == 1
    assert bore_brightness(1e-3, 0.0, optics, lamp_aperture=0.3) == 1


def test_the_aperture_left_in_the_papers_bore() -> None:
    optics = microscope()
    assert round(bore_aperture(25.0, 100.0, optics), 2) == 0.24
    once = bore_brightness(25.0, 100.0, optics)
    assert math.isclose(once, (0.242536 / 0.42) ** 2, rel_tol=1e-5)
    twice = bore_brightness(25.0, 100.0, optics, lamp_aperture=0.42)
    assert math.isclose(twice, once**2)
    tangent = math.tan(math.asin(0.42))
    in_tangents = (25 / (100 * tangent)) ** 2 * (1 + tangent**2) / (1 + 0.25**2)
    assert math.isclose(once, in_tangents)


def test_a_straight_edge_above_shades_half_of_what_is_below_it() -> None:
    optics, height = microscope(), 40.0
    body = over(rectangle(0, -200, 200, 200), height)
    grid = Grid(left_um=-25.0, top_um=0.25, step_um=0.5, shape=(1, 100))
    found = light_share((body,), optics, grid, 0.0, samples=SAMPLES)[0]
    x = -24.75 + 0.5 * np.arange(100)
    slope = math.tan(math.asin(optics.aperture))
    assert np.all(found[x < -height * slope - 0.5] == 1)
    assert np.all(found[x > height * slope + 0.5] == 0)
    # 2000 points by their sides of a line: 2000**-.75, and a cell of 2 * 18.5 um
    assert abs(found[(x > -0.5) & (x < 0.5)].mean() - 0.5) < 0.01
    np.testing.assert_allclose(found, 1 - found[::-1], atol=0.02)


def test_light_from_below_the_face_is_not_hidden() -> None:
    optics = microscope()
    low = over(disc(50.0), 0.0)
    assert np.all(light_share((low,), optics, middle(5), 0.0) == 1)


@pytest.mark.parametrize("lamp", [0.42, 0.2, 1e-6])  # the last: straight down
def test_a_post_in_a_bore_is_as_bright_as_the_closed_form(lamp: float) -> None:
    optics = microscope(6.9, 3, 3)
    post = Layer(name="post", outline=disc(22.0), z_um=0.0, reflectance=0.75)
    scene = Scene(layers=(post, over(plate(25.0), 100.0)), background=0.0)
    found = occluded(
        scene, optics, focus_um=0.0, lamp_aperture=lamp, samples=1000, step_um=0.6
    )
    expected = 0.75 * bore_brightness(25.0, 100.0, optics, lamp_aperture=lamp)
    # cells of .54 um at a rim of 25, for both ways
    assert abs(found[1, 1] - expected) < expected * 2 * 0.54 / 25


def test_the_centre_of_a_post_seen_through_a_bore_is_not_biased() -> None:
    optics = microscope(6.9, 56, 56)
    post = Layer(name="post", outline=disc(22.0), z_um=0.0, reflectance=0.75)
    for offset_um in (0.0, 3.0):
        bore = Outline(
            rings=(
                *rectangle(-250, -250, 250, 250).rings,
                circle(25.0, (offset_um, 0.0), hole=True),
            )
        )
        scene = Scene(layers=(post, over(bore, 100.0)), background=0.0)
        image = occluded(scene, optics, focus_um=0.0, lamp_aperture=0.42)
        right, left = (_edge_um(row, optics.um_per_px) for row in _halves(image))
        # the shade dims one side more than the other; each edge keeps its half height
        assert abs(right - left) / 2 < 0.1
        assert abs((right + left) / 2 - 22.0) < 0.2


def _halves(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of the two middle rows, from the middle to both sides."""
    row = image[27:29].mean(axis=0)
    return row[28:], row[27::-1]


def _edge_um(row: np.ndarray, pitch_um: float) -> float:
    """Return where a row falls through half of what it is 4 um within the edge."""
    half = row[int(18 / pitch_um)] / 2
    i = int(np.flatnonzero(row < half)[0])
    return float(i - 0.5 + (row[i - 1] - half) / (row[i - 1] - row[i])) * pitch_um
