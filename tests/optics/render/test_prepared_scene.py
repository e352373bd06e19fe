"""Scenes prepared once against scenes rendered anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.optics.render.prepared_scene import prepare
from microplan.optics.render.render import render, render_stack
from microplan.optics.render.sampling import FAR_ERROR, SINGLE_ERROR, Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import Range
from tests.optics.shapes import disc, gear, microscope, one_layer, rectangle

DOUBLE = Sampling(band_error=1e-12)
SINGLE = replace(DOUBLE, single=True)
# Each image of a pair is off by the correction of its tile, and the margins may differ
# by what a shift or a zoom asks for: 2 % of the 1e-3 that a margin costs.
APART = 2 * FAR_ERROR + 2e-5


def _two_layers() -> Scene:
    plate = rectangle(-300.0, -12.0, 4.0, 500.0)
    return Scene(
        layers=(
            Layer(name="plate", outline=plate, z_um=-20.0, reflectance=0.4),
            Layer(name="gear", outline=gear(), z_um=3.0, reflectance=0.9),
        ),
        background=0.1,
    )


@pytest.mark.parametrize("magnification", [6.9, 44.5])
@pytest.mark.parametrize("z_um", [0.0, 3.0, -25.0, 50.0])
def test_single_precision_is_harmless(magnification: float, z_um: float) -> None:
    optics = microscope(magnification)
    scene = _two_layers()
    images = [
        render(scene, optics, focus_um=z_um, sampling=sampling)
        for sampling in (DOUBLE, SINGLE)
    ]
    assert 0 < np.abs(images[0] - images[1]).max() < SINGLE_ERROR


def test_single_precision_is_harmless_on_a_large_frame() -> None:
    optics = microscope(44.5, 640, 480)
    focus = (-50.0, -2.5, 0.0, 25.0)
    stacks = [
        render_stack(one_layer(gear()), optics, focus_um=focus, sampling=sampling)
        for sampling in (DOUBLE, SINGLE)
    ]
    assert stacks[1].dtype == np.float64
    assert np.abs(stacks[0] - stacks[1]).max() < SINGLE_ERROR


@pytest.mark.parametrize("sampling", [DOUBLE, SINGLE])
@pytest.mark.parametrize("shift_um", [(0.0, 0.0), (1.3, -0.7), (-5.0, 4.21)])
def test_a_shift_is_a_phase_ramp(
    sampling: Sampling, shift_um: tuple[float, float]
) -> None:
    optics, scene = microscope(20.0), _two_layers()
    reach = Range(focus_um=(-5.0, 10.0), shift_um=5.0)
    ready = prepare(scene, optics, reach, sampling=sampling)
    expected = render(scene, optics, focus_um=10.0, shift_um=shift_um, sampling=DOUBLE)
    found = ready.image(focus_um=10.0, shift_um=shift_um)
    assert np.abs(found - expected).max() < APART


@pytest.mark.parametrize("zoom", [0.95, 0.998, 1.0, 1.004, 1.05])
def test_a_zoom_samples_the_same_spectrum(zoom: float) -> None:
    optics, scene = microscope(20.0), _two_layers()
    reach = Range(focus_um=(0.0, 0.0), zoom=(0.95, 1.05), shift_um=2.0)
    ready = prepare(scene, optics, reach, sampling=DOUBLE)
    closer = replace(optics, magnification=optics.magnification * zoom)
    expected = render(
        scene, closer, focus_um=0.0, shift_um=(2.0, -1.0), sampling=DOUBLE
    )
    found = ready.image(focus_um=0.0, shift_um=(2.0, -1.0), zoom=zoom)
    assert np.abs(found - expected).max() < APART


def test_light_and_window_are_those_of_the_image() -> None:
    optics, scene = microscope(20.0), _two_layers()
    window = Window(row=30, column=-10, rows=50, columns=70)
    light = Illumination(gain=0.8, gradient_x=0.1, gradient_y=-0.2)
    reach = Range(focus_um=(0.0, 0.0))
    ready = prepare(scene, optics, reach, window=window, sampling=DOUBLE)
    expected = render(
        scene, optics, focus_um=0.0, window=window, light=light, sampling=DOUBLE
    )
    assert np.abs(ready.image(focus_um=0.0, light=light) - expected).max() < APART


def test_images_do_not_depend_on_those_before() -> None:
    optics, scene = microscope(20.0), _two_layers()
    reach = Range(focus_um=(-20.0, 20.0), shift_um=1.0, zoom=(0.99, 1.01))
    views = [
        (5.0, 1.0),
        (1.0, 1.0),  # as far from the gear as the first, not from the plate
        (-20.0, 1.01),
        (5.0, 0.99),
        (5.0, 1.0),
    ]
    used = prepare(scene, optics, reach)
    views += reversed(views)
    in_turn = [used.image(focus_um=z_um, zoom=zoom) for z_um, zoom in views]
    for (z_um, zoom), image in zip(views, in_turn, strict=True):
        fresh = prepare(scene, optics, reach).image(focus_um=z_um, zoom=zoom)
        np.testing.assert_array_equal(image, fresh)


def test_images_beyond_the_range_are_refused() -> None:
    reach = Range(focus_um=(0.0, 5.0), shift_um=1.0, zoom=(0.99, 1.01))
    ready = prepare(one_layer(disc(9.0)), microscope(), reach)
    for focus_um, zoom in ((5.1, 1.0), (0.0, 1.02), (math.nan, 1.0)):
        with pytest.raises(ValueError, match="prepared for"):
            ready.image(focus_um=focus_um, zoom=zoom)
    with pytest.raises(ValueError, match="prepared for"):
        ready.image(focus_um=0.0, shift_um=(0.0, 1.1))


@pytest.mark.parametrize(
    ("focus_um", "shift_um", "zoom"),
    [
        ((1.0, 0.0), 0.0, (1.0, 1.0)),
        ((0.0, math.inf), 0.0, (1.0, 1.0)),
        ((0.0, 0.0), -1.0, (1.0, 1.0)),
        ((0.0, 0.0), 0.0, (0.0, 1.0)),
        ((0.0, 0.0), 0.0, (1.1, 1.0)),
    ],
)
def test_ranges_that_cannot_be_are_refused(
    focus_um: tuple[float, float], shift_um: float, zoom: tuple[float, float]
) -> None:
    with pytest.raises(ValueError, match=r"range|finite|zoom"):
        Range(focus_um=focus_um, shift_um=shift_um, zoom=zoom)


def test_planes_on_both_sides_of_a_layer_share_its_blur() -> None:
    scene, focus = one_layer(gear(), 3.0), (1.0, 5.0, -7.0, 13.0)
    stack = render_stack(scene, microscope(), focus_um=focus)
    np.testing.assert_array_equal(stack[0], stack[1])
    np.testing.assert_array_equal(stack[2], stack[3])
    alone = render(scene, microscope(), focus_um=13.0)
    # apart are the margins, of which 1e-3 is the cost, and single precision
    assert np.abs(stack[3] - alone).max() < 1e-3 + SINGLE_ERROR
