"""Rendered images against brute force, conservation, symmetry and the blend formula."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment, place
from microplan.optics.render.render import render, render_stack
from microplan.optics.render.sampling import BAND_ERROR, margin_error, margin_um
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import transfer
from microplan.optics.transfer.otf import diffraction, product
from tests.optics.shapes import (
    brute_force,
    circle,
    disc,
    gear,
    microscope,
    one_layer,
    rectangle,
)

RING = Outline(rings=(circle(20.0, (5.3, -3.7)), circle(8.0, (5.3, -3.7), hole=True)))
# what the renderer predicts for itself, of unit contrast
PREDICTED = BAND_ERROR + margin_error()


def _ring_distance(x: FloatArray, y: FloatArray) -> FloatArray:
    r = np.hypot(x - 5.3, y + 3.7)
    return np.minimum(20.0 - r, r - 8.0)


def _half_disc() -> Outline:
    arc = Arc(center=(-2.0, 1.0), radius_um=15.0, start_rad=0.0, sweep_rad=math.pi)
    return Outline(rings=(Ring(edges=(arc, Segment(start=arc.end, end=arc.start))),))


def _half_disc_distance(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.minimum(15.0 - np.hypot(x + 2.0, y - 1.0), y - 1.0)


def _law(optics: Microscope, z_um: float) -> Callable[[FloatArray], FloatArray]:
    """Return the renderer's default law as a function of share of the cutoff."""
    return lambda x: transfer("exact", optics, z_um, x * optics.cutoff_per_um)


@pytest.mark.parametrize(
    "z_um",
    # in focus, the ring of the next test says the same
    [pytest.param(0.0, marks=pytest.mark.slow), 2.5, -10.0, 40.0],
)
@pytest.mark.parametrize(
    ("outline", "distance"),
    [(RING, _ring_distance), (_half_disc(), _half_disc_distance)],
    ids=["ring", "half disc"],
)
def test_images_meet_brute_force(
    outline: Outline,
    distance: Callable[[FloatArray, FloatArray], FloatArray],
    z_um: float,
) -> None:
    optics = microscope(6.9, 64, 48)  # undersampled: the spectrum folds
    expected = brute_force(
        distance,
        optics,
        _law(optics, z_um),
        samples=16 if abs(z_um) < 5 else 8,
    )
    found = render(one_layer(outline, z_um), optics, focus_um=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=BAND_ERROR)


def test_brute_force_closes_in_on_the_renderer() -> None:
    # the raster errs with the square of its step; what stays is the band cut
    optics = microscope(6.9, 64, 48)
    found = render(one_layer(RING), optics, focus_um=0.0)
    errors = [
        np.abs(
            brute_force(_ring_distance, optics, diffraction, samples=n) - found
        ).max()
        for n in (2, 4, 16)
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < BAND_ERROR


def test_the_product_law_meets_brute_force() -> None:
    optics = microscope(6.9, 64, 48)
    w = optics.paraxial_w20_um(20.0) / optics.wavelength_um
    expected = brute_force(_ring_distance, optics, lambda x: product(x, w), samples=8)
    found = render(one_layer(RING, 20.0), optics, focus_um=0.0, model="product")
    np.testing.assert_allclose(found, expected, rtol=0, atol=BAND_ERROR)


def test_light_is_conserved() -> None:
    optics = microscope()
    for z_um in (0.0, 5.0, -20.0):
        image = render(one_layer(RING, z_um), optics, focus_um=0.0)
        seen = image.sum() * optics.um_per_px**2
        # what leaves the frame is the tail of the blur: r > 50 um, 1.43 / (pi**2 r)
        assert seen == pytest.approx(RING.area_um2, rel=3e-3)


def test_a_part_moved_by_a_pixel_moves_its_image_by_a_pixel() -> None:
    optics = microscope(6.9, 280, 260)  # so large that it cuts no margin
    p = optics.um_per_px
    before = render(one_layer(gear(), 4.0), optics, focus_um=0.0)
    after = render(one_layer(place(gear(), p, -2 * p), 4.0), optics, focus_um=0.0)
    np.testing.assert_allclose(after[2:, 1:], before[:-2, :-1], rtol=0, atol=1e-9)


def test_x_is_right_and_y_is_up() -> None:
    optics = microscope()
    image = render(one_layer(disc(4.0, (30.0, 20.0))), optics, focus_um=0.0)
    row, column = np.mgrid[:120, :160]
    k = optics.px_per_um
    # the tails cut off by the frame pull by less than a hundredth of a pixel
    assert (image * column).sum() / image.sum() == pytest.approx(79.5 + 30 * k, abs=0.1)
    assert (image * row).sum() / image.sum() == pytest.approx(59.5 - 20 * k, abs=0.1)
    top = np.unravel_index(np.argmax(image), image.shape)
    assert abs(top[0] - (59.5 - 20 * k)) < 2
    assert abs(top[1] - (79.5 + 30 * k)) < 2


def test_a_shift_of_the_image_is_a_shift_of_the_scene() -> None:
    optics = microscope()
    moved = render(one_layer(place(gear(), 2.3, -1.1)), optics, focus_um=3.0)
    shifted = render(one_layer(gear()), optics, focus_um=3.0, shift_um=(2.3, -1.1))
    np.testing.assert_allclose(shifted, moved, rtol=0, atol=1e-9)


@pytest.mark.parametrize("z_um", [0.0, 25.0])
def test_a_window_is_a_part_of_the_frame(z_um: float) -> None:
    optics = microscope()
    scene = Scene(
        layers=(
            Layer(name="plate", outline=rectangle(-20, -300, 9e3, 300), z_um=-10.0,
                  reflectance=0.4),
            Layer(name="gear", outline=gear(), z_um=z_um, reflectance=0.8),
        ),
        background=0.1,
    )  # fmt: skip
    light = Illumination(gain=0.9, gradient_x=0.3, gradient_y=-0.2)
    whole = render(scene, optics, focus_um=0.0, light=light)
    window = Window(row=31, column=64, rows=40, columns=53)
    part = render(scene, optics, focus_um=0.0, light=light, window=window)
    # the plate leaves the window's tile at another place than the frame's
    np.testing.assert_allclose(
        part, whole[31:71, 64:117], rtol=0, atol=2 * margin_error()
    )


def test_a_window_may_reach_beyond_the_frame() -> None:
    optics = microscope()
    window = Window(row=-20, column=-30, rows=200, columns=250)
    image = render(one_layer(gear()), optics, focus_um=0.0, window=window)
    frame = render(one_layer(gear()), optics, focus_um=0.0)
    np.testing.assert_allclose(
        image[20:140, 30:190], frame, rtol=0, atol=2 * margin_error()
    )


def test_nothing_wraps_around() -> None:
    # a disc beyond the left border must not show at the right one
    optics = microscope()
    half = optics.field_um[0] / 2
    for z_um in (0.0, 30.0):
        scene = one_layer(disc(8.0, (-half - 5.0, 0.0)), z_um)
        image = render(scene, optics, focus_um=0.0)
        assert image[:, :5].max() > 0.01
        assert np.abs(image[:, 80:]).max() < margin_error()


def test_a_blur_larger_than_the_part_spreads_its_light_evenly() -> None:
    optics = Microscope(
        aperture=0.42,
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=6.9,
        pitch_um=7.5,
        width_px=640,
        height_px=480,
    )
    window = Window(row=140, column=220, rows=200, columns=200)
    image = render(one_layer(disc(30.0), 250.0), optics, focus_um=0.0, window=window)
    # a uniform circle of the rim's paraxial equivalent, twice W20 / A across
    radius = 2 * optics.rim_w20_um(250.0) / 0.42
    even = (30.0 / radius) ** 2
    assert image[100, 100] == pytest.approx(even, rel=0.1)
    whole = render(one_layer(disc(30.0), 250.0), optics, focus_um=0.0)
    assert whole.shape == (480, 640)
    np.testing.assert_allclose(
        whole[140:340, 220:420], image, rtol=0, atol=2 * BAND_ERROR
    )


@pytest.mark.parametrize("z_um", [0.0, 4.0, -30.0])
def test_an_endless_edge_is_the_integral_of_its_transfer(z_um: float) -> None:
    # 1/2 + int H(f) sinc(f p) sin(2 pi f x) / (pi f) df, for an edge along y at x = 3
    optics = microscope()
    image = render(one_layer(rectangle(3.0, -1e4, 2e4, 1e4), z_um), optics, focus_um=0)
    nodes, weights = np.polynomial.legendre.leggauss(800)
    f = (1 + nodes) / 2 * optics.cutoff_per_um
    share = transfer("exact", optics, z_um, f)
    share *= np.sinc(f * optics.um_per_px) * weights / 2 * optics.cutoff_per_um
    x = (np.arange(160) - 79.5) * optics.um_per_px - 3.0
    edge = 0.5 + np.sin(2 * np.pi * f * x[:, None]) / (np.pi * f) @ share
    np.testing.assert_allclose(
        image, np.broadcast_to(edge, image.shape), rtol=0, atol=PREDICTED
    )


def _finger_distance(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.minimum(np.minimum(30.0 - np.abs(x - 7.0), y - 10.0), 60.0 - y)


@pytest.mark.parametrize("z_um", [0.0, 20.0])
def test_a_body_that_leaves_the_window_does_not_come_in_again(z_um: float) -> None:
    # the finger is cut above the window, its tip lies inside, and below is black
    optics = microscope(6.9, 160, 120)
    expected = brute_force(_finger_distance, optics, _law(optics, z_um), samples=8)
    for rows in (30, 50):
        window = Window(row=110 - rows, column=0, rows=rows, columns=160)
        found = render(
            one_layer(rectangle(-23.0, 10.0, 37.0, 60.0), z_um),
            optics,
            focus_um=0.0,
            window=window,
        )
        truth = expected[110 - rows : 110]
        np.testing.assert_allclose(found, truth, rtol=0, atol=PREDICTED)


def test_a_finger_from_far_above_leaves_black_below() -> None:
    optics = microscope(6.9, 160, 400)
    image = render(
        one_layer(rectangle(-30.0, 10.0, 30.0, 20_800.0)), optics, focus_um=0
    )
    below = image[210:].max(axis=1)  # rows from 1 um above the tip's edge downwards
    rows = np.arange(below.size)
    assert below[0] < 1
    # the tail of an edge d away, with the band's error and the margin's
    assert (below[10:] < 0.0323 * 1.43 / (rows[10:] - 10 + 1) / 1.087 + PREDICTED).all()


def test_fingers_of_20_mm_are_clipped() -> None:
    optics = microscope()
    long = render(one_layer(rectangle(-30, 10, 30, 20_800)), optics, focus_um=0.0)
    short = render(one_layer(rectangle(-30, 10, 30, 400)), optics, focus_um=0.0)
    np.testing.assert_allclose(long, short, rtol=0, atol=margin_error())
    assert long[5, 80] == pytest.approx(1.0, abs=0.05)


def test_a_layer_over_the_whole_field_is_uniform() -> None:
    plate = rectangle(-1e5, -1e5, 1e5, 1e5)
    image = render(one_layer(plate, 123.0), microscope(), focus_um=0.0)
    np.testing.assert_allclose(image, 1.0, rtol=0, atol=1e-12)


def test_an_empty_scene_is_its_background() -> None:
    image = render(Scene(layers=(), background=0.25), microscope(), focus_um=0.0)
    np.testing.assert_array_equal(image, np.full((120, 160), 0.25))
    gone = Scene(
        layers=(
            Layer(name="far", outline=disc(5.0, (9e3, 0.0)), z_um=0.0, reflectance=1.0),
            Layer(name="none", outline=Outline(rings=()), z_um=0.0, reflectance=1.0),
        ),
        background=0.25,
    )
    np.testing.assert_array_equal(render(gone, microscope(), focus_um=0.0), image)


def _two(z_back: float, z_front: float, order: int = 1) -> Scene:
    back = Layer(name="a", outline=gear(), z_um=z_back, reflectance=0.6)
    front = Layer(name="b", outline=disc(30.0, (20.0, 0.0)), z_um=z_front,
                  reflectance=0.9)  # fmt: skip
    return Scene(layers=(back, front)[::order], background=0.1)


def test_layers_are_blended_front_over_back() -> None:
    optics = microscope()
    image = render(_two(0.0, 8.0), optics, focus_um=8.0)
    back, front = (
        render(one_layer(outline, z), optics, focus_um=8.0)
        for outline, z in ((gear(), 0.0), (disc(30.0, (20.0, 0.0)), 8.0))
    )
    expected = (1 - front) * ((1 - back) * 0.1 + 0.6 * back) + 0.9 * front
    np.testing.assert_allclose(image, expected, rtol=0, atol=1e-12)


def test_the_order_of_layers_does_not_matter() -> None:
    optics = microscope()
    for heights in ((0.0, 8.0), (0.0, 0.0)):
        one = render(_two(*heights), optics, focus_um=3.0)
        other = render(_two(*heights, order=-1), optics, focus_um=3.0)
        np.testing.assert_array_equal(one, other)


def test_halves_of_a_body_look_like_the_body() -> None:
    # two layers of one height side by side, out of focus: added, not blended
    optics = microscope()
    parts = [rectangle(-30, -20, 0, 20), rectangle(0, -20, 30, 20)]
    halves = Scene(
        layers=tuple(
            Layer(name=f"part {i}", outline=part, z_um=12.0, reflectance=0.8)
            for i, part in enumerate(parts)
        ),
        background=0.3,
    )
    whole = Layer(
        name="part", outline=rectangle(-30, -20, 30, 20), z_um=12.0, reflectance=0.8
    )
    found = render(halves, optics, focus_um=0.0)
    expected = render(Scene(layers=(whole,), background=0.3), optics, focus_um=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=PREDICTED)


def test_overlapping_bodies_of_one_height_hide_each_other() -> None:
    image = render(_two(0.0, 0.0), microscope(), focus_um=0.0)
    assert image.max() <= 0.9 + PREDICTED
    assert image[59, 101] == pytest.approx(0.9, abs=0.02)  # "b" lies over "a"


def test_light_refers_to_the_whole_field() -> None:
    optics = microscope()
    light = Illumination(gain=2.0, gradient_x=0.4, gradient_y=-0.1)
    flat = Scene(layers=(), background=0.5)
    image = render(flat, optics, focus_um=0.0, light=light)
    assert image[:, -1].mean() - image[:, 0].mean() == pytest.approx(
        0.4 * 159 / 160, rel=1e-12
    )
    assert image[0, :].mean() - image[-1, :].mean() == pytest.approx(
        -0.1 * 119 / 120, rel=1e-12
    )
    assert image.mean() == pytest.approx(1.0, rel=1e-12)


def test_a_stack_is_its_planes() -> None:
    optics = microscope()
    scene = _two(0.0, 8.0)
    focus = (-5.0, 0.0, 8.0, 40.0)
    stack = render_stack(scene, optics, focus_um=focus)
    assert stack.shape == (4, 120, 160)
    for plane, focus_um in zip(stack, focus, strict=True):
        single = render(scene, optics, focus_um=focus_um)
        np.testing.assert_allclose(plane, single, rtol=0, atol=margin_error())


def test_a_smaller_fill_factor_is_sharper() -> None:
    edge = one_layer(rectangle(-300, -300, 0, 300))
    slopes = []
    for fill in (1.0, 0.25):
        optics = Microscope(
            aperture=0.42, wavelength_um=0.6, medium_index=1.0, fill_factor=fill,
            magnification=6.9, pitch_um=7.5,
            width_px=64, height_px=64,
        )  # fmt: skip
        image = render(edge, optics, focus_um=0.0)
        slopes.append(image[32, 31] - image[32, 32])
    assert slopes[1] > slopes[0]


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-60, 60),
    st.floats(-60, 60),
    st.floats(0.02, 80),
    st.floats(-400, 400),
    st.sampled_from(["product", "stokseth", "hopkins", "exact"]),
)
def test_images_of_a_disc_stay_in_range_and_mirror(
    x: float, y: float, radius: float, z_um: float, model: str
) -> None:
    optics = microscope()
    image = render(one_layer(disc(radius, (x, y)), z_um), optics, focus_um=0.0,
                   model=model)  # fmt: skip
    assert np.isfinite(image).all()
    # jinc products are no true point spreads: they ring a few percent below zero
    slack = 0.05 if model in ("product", "stokseth") else PREDICTED
    assert image.min() >= -slack
    assert image.max() <= 1 + slack
    turned = render(one_layer(disc(radius, (-x, -y)), -z_um), optics, focus_um=0.0,
                    model=model)  # fmt: skip
    # tiles are not mirrored: a tail may wrap in one image and be left out in the other
    np.testing.assert_allclose(
        turned[::-1, ::-1], image, rtol=0, atol=BAND_ERROR + 2 * margin_error()
    )


def test_defocus_of_5_mm_works() -> None:
    image = render(one_layer(gear(), 5000.0), microscope(), focus_um=0.0)
    assert np.isfinite(image).all()
    assert image.max() < 0.01
    assert margin_um(microscope(), 5000.0) > 2000


def test_numbers_that_cannot_be_are_refused() -> None:
    scene = one_layer(gear())
    with pytest.raises(ValueError, match="focus_um must be finite"):
        render(scene, microscope(), focus_um=math.nan)
    with pytest.raises(ValueError, match="shift_um must be finite"):
        render(scene, microscope(), focus_um=0.0, shift_um=(math.inf, 0.0))
    with pytest.raises(ValueError, match="model must be one of"):
        render(scene, microscope(), focus_um=0.0, model="gauss")


def test_the_geometric_law_renders_too() -> None:
    optics = microscope()
    image = render(one_layer(gear(), 20.0), optics, focus_um=0.0, model="geometric")
    exact = render(one_layer(gear(), 20.0), optics, focus_um=0.0)
    # .04 at m = 44.5 between 10 and 25 um, see `fidelity.LAW_ERROR`
    assert 0.001 < np.abs(image - exact).max() < 0.066
