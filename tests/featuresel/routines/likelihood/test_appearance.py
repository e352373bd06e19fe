from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.routines.likelihood.appearance import (
    Appearance,
    ImagePose,
    read_appearance,
)
from tests.featuresel.fits import Drawn, artifact, case, draw, render

LOOKS = ("find_gear", "post", "far_gear")
SINGLE = float(np.finfo(np.float32).eps)


@cache
def looks(name: str) -> Appearance:
    return read_appearance(artifact(name))


def off_by(name: str, drawn: Drawn, image: FloatArray) -> tuple[float, FloatArray]:
    """Return what the model is off by: most, and as pulls.

    The most of any pixel, in deviations of the noise where the target is brightest;
    and what column, row and turn move by, in their limits on these pixels.
    """
    pose = drawn.pose(case(name))
    columns, rows = looks(name).pixels(pose, image.shape)
    assert len(columns) > 500
    found, shown = looks(name).light(pose, columns, rows), image[rows, columns]
    variance = render(name).camera.variance(shown)
    slopes = [found.across, found.down, found.grow, found.value]
    if case(name).theta_any:
        slopes.insert(2, found.turn)
    scores = np.stack(slopes) / np.sqrt(variance)
    covariance = np.linalg.inv(scores @ scores.T)
    error = found.value - shown
    moved = covariance @ scores @ (error / np.sqrt(variance))
    pulls: FloatArray = moved / np.sqrt(np.diag(covariance))
    return float(np.abs(error).max() / np.sqrt(variance.max())), pulls[:-2]


@pytest.mark.parametrize("name", LOOKS)
@pytest.mark.parametrize("share", [0.0, 0.07, 0.3, 0.6, 0.95])
def test_light_is_the_renderers_to_a_tenth_of_the_noise(
    name: str, share: float
) -> None:
    rng = np.random.default_rng(int(100 * share))
    z_um = share * looks(name).reach_um
    for sign in (1, -1):
        drawn = draw(name, rng, z_um=sign * z_um)
        image = drawn.render(render(name))
        most, pulls = off_by(name, drawn, image)
        assert most < 0.1
        assert (np.abs(pulls) < 0.1).all()


@pytest.mark.parametrize("name", LOOKS)
@pytest.mark.parametrize("move", [(0.49, 0.0), (-0.49, 0.0), (0.0, 0.49), (0.0, -0.49)])
def test_pixels_show_the_target_half_a_pixel_on(
    name: str, move: tuple[float, float]
) -> None:
    # so far a fit moves before it chooses its pixels anew
    drawn = draw(name, np.random.default_rng(3), z_um=0.4 * looks(name).reach_um)
    image, pose = drawn.render(render(name)), drawn.pose(case(name))
    before = replace(pose, column=pose.column + move[0], row=pose.row + move[1])
    columns, rows = looks(name).pixels(before, image.shape)
    error = looks(name).light(pose, columns, rows).value - image[rows, columns]
    noise = math.sqrt(render(name).camera.variance(image).max())
    assert np.abs(error).max() < 0.1 * noise


@pytest.mark.parametrize("zoom", [0.98, 0.995])
def test_zoom_leaves_the_pixels_size_alone(zoom: float) -> None:
    # planes hold the light of a pixel of the nominal side: at a zoom z it is that of
    # a pixel z times as wide
    scope = replace(case("find_gear").microscope, fill_factor=zoom**2)
    look = nominal_render(replace(case("find_gear"), microscope=scope))
    drawn = replace(draw("find_gear", np.random.default_rng(4)), zoom=zoom)
    assert off_by("find_gear", drawn, drawn.render(look))[0] < 0.1
    # which one deviation of the zoom off moves nothing that could be told
    assert case("find_gear").spread.magnification_sigma == 0.005
    off = replace(drawn, zoom=1 - 0.005)
    pulls = off_by("find_gear", off, off.render(render("find_gear")))[1]
    assert (np.abs(pulls) < 0.1).all()


@pytest.mark.parametrize("name", ["post", "find_gear"])
@pytest.mark.parametrize("z_um", [0.5, 6.0])
def test_slopes_are_differences(name: str, z_um: float) -> None:
    drawn = replace(draw(name, np.random.default_rng(8), z_um=z_um), zoom=1.01)
    pose = drawn.pose(case(name))
    columns, rows = looks(name).pixels(pose, (200, 200))
    rim_px = max(looks(name).shape) / 2 / looks(name).over
    light = looks(name).light(pose, columns, rows)

    def difference(step: float, **by: float) -> FloatArray:
        high, low = (
            looks(name).light(_moved(pose, by, h), columns, rows).value
            for h in (step, -step)
        )
        return (high - low) / (2 * step)

    turned = _by_harmonics(looks(name), pose)
    slopes = {
        "column": light.across,
        "row": light.down,
        "turn_rad": (light.turn + turned.light(pose, columns, rows).value) / rim_px,
        "z_um": light.focus * 2 * z_um,  # it is by the square
        "zoom": light.grow / rim_px,
    }
    scales = {"turn_rad": 1 / rim_px, "zoom": 1 / rim_px}  # px at the rim
    for key, slope in slopes.items():
        by = {key: scales.get(key, 1.0)}
        near, far = difference(0.02, **by), difference(0.04, **by)
        # a third of what it changes by is left; and sums of 32 bit round
        tolerance = np.abs(far - near).max() + 16 * SINGLE / 0.02
        assert np.abs(near - slope).max() < tolerance, key
        assert tolerance < 0.05 * np.abs(light.across).max(), key


def _moved(pose: ImagePose, by: dict[str, float], step: float) -> ImagePose:
    return replace(pose, **{k: getattr(pose, k) + step * v for k, v in by.items()})


def _by_harmonics(planes: Appearance, pose: ImagePose) -> Appearance:
    """Return what the turn of the pixels alone changes, left out of the slopes."""
    if planes.planes.shape[1] == 1:
        return replace(planes, planes=0 * planes.planes)
    c, s = math.cos(4 * pose.turn_rad), math.sin(4 * pose.turn_rad)
    mixed = 4 * (c * planes.planes[:, 2:] - s * planes.planes[:, 1:2])
    return replace(planes, planes=mixed.astype(np.float32))


def test_the_slope_by_focus_squared_is_finite_in_focus() -> None:
    pose = Drawn().pose(case("post"))
    columns, rows = looks("post").pixels(pose, (200, 200))
    in_focus = looks("post").light(pose, columns, rows)
    # a quarter step out: half the change to it over half the square
    off_um = looks("post").step_um / 2
    away = looks("post").light(replace(pose, z_um=off_um), columns, rows)
    chord = (away.value - in_focus.value) / off_um**2
    assert np.isfinite(in_focus.focus).all()
    # between in focus and a full step out curvature changes by its own size at most
    assert np.corrcoef(chord, in_focus.focus)[0, 1] > 0.95
    assert np.abs(in_focus.focus).max() < 2 * np.abs(chord).max()


def test_many_turns_at_once_are_each_alone() -> None:
    pose = draw("find_gear", np.random.default_rng(5), z_um=3.0).pose(case("find_gear"))
    cells = looks("find_gear").some_cells(3.0, 300)
    assert 300 <= len(cells) < 600
    turns = np.array([-2.0, 0.0, 0.3, 3.0])
    many = looks("find_gear").turned(pose, turns, cells, (200, 200))
    assert many.inside.all()
    for k, turn in enumerate(turns):
        here = replace(pose, turn_rad=float(turn))
        one = looks("find_gear").light(here, many.columns[k], many.rows[k])
        np.testing.assert_allclose(many.value[k], one.value, atol=16 * SINGLE)


def test_what_is_out_of_view_is_not_compared() -> None:
    pose = Drawn().pose(case("find_gear"))
    cells = looks("find_gear").some_cells(0.0, 300)
    half = replace(pose, column=0.0)
    columns, _ = looks("find_gear").pixels(half, (200, 200))
    assert columns.min() == 0
    gone = looks("find_gear").turned(half, np.array([0.1]), cells, (200, 200))
    assert 0.3 < gone.inside.mean() < 0.7
    assert gone.columns.min() == 0
    away = replace(pose, column=-500.0)
    assert len(looks("find_gear").pixels(away, (200, 200))[0]) == 0
    assert len(looks("find_gear").pixels(pose, (0, 0))[0]) == 0


def test_both_sides_of_focus_are_alike_only_about_focus() -> None:
    assert looks("find_gear").is_even
    assert not looks("far_gear").is_even
    for name in LOOKS:
        sigma_um = case(name).spread.focus_sigma_um
        assert looks(name).reach_um == pytest.approx(3 * sigma_um, rel=1e-9)
