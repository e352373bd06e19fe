"""Coaxial light against closed forms, rays counted one by one, and traced images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import Irradiance, irradiances
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial, shade_error
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import Covered, cover, render
from microplan.optics.render.sampling import margin_error
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.bore import bore_brightness
from tests.optics.shapes import circle, disc, gear, microscope, rectangle

LAMP = 0.42


def plate(radius_um: float, z_um: float) -> Layer:
    """Return a dark plate with a round bore."""
    outer = rectangle(-250, -250, 250, 250).rings
    outline = Outline(rings=(*outer, circle(radius_um, hole=True)))
    return Layer(name="plate", outline=outline, z_um=z_um, reflectance=0.0)


def body(name: str, outline: Outline, z_um: float, reflectance: float) -> Layer:
    """Return a layer."""
    return Layer(name=name, outline=outline, z_um=z_um, reflectance=reflectance)


def grasp(stage_um: float | None = None) -> Scene:
    """Return a gear between two fingers 130 um above it."""
    fingers = (
        body(name, rectangle(x, -60, x + 100, 900), 230.0, 0.7)
        for name, x in (("left", -165.0), ("right", 65.0))
    )
    layers = (body("gear", gear(), 100.0, 0.8), *fingers)
    return Scene(layers=layers, background=0.1, background_z_um=stage_um)


@pytest.mark.parametrize(
    ("radius_um", "depth_um", "lamp"),
    [(25.0, 100.0, 0.42), (25.0, 60.0, 0.42), (25.0, 100.0, 0.6), (80.0, 100.0, 0.2),
     (25.0, 100.0, 0.2), (25.0, 100.0, 1e-6), (10.0, 300.0, 0.42)],
)  # fmt: skip
def test_a_bores_floor_gets_the_share_of_the_closed_form(
    radius_um: float, depth_um: float, lamp: float
) -> None:
    optics = microscope(6.9, 3, 3)
    over = plate(radius_um, depth_um)
    (light,) = irradiances((over,), (0.0,), optics, lamp_aperture=lamp, focus_um=(0.0,))
    seen = bore_brightness(radius_um, depth_um, replace(optics, aperture=lamp))
    kept = 0.0
    if light.shades:
        (shade,) = light.shades
        kept = shade.kept[-shade.lattice.window.row, -shade.lattice.window.column]
    # the Airy pattern that remains is 1 / 200 of the radius, of all light this share
    # lies beyond the distance of the two rims; band and margin come on top
    radius = replace(optics, aperture=lamp).blur_diameter_um(depth_um) / 2
    tail = max(radius / 200, optics.um_per_px / 16) / abs(radius - radius_um) / np.pi**3
    assert abs(1 - kept - seen) < 2 * tail + 1e-3 + margin_error(12.0)


def test_a_nearly_parallel_lamp_throws_the_body_itself() -> None:
    """As a square about each point sees it; twice the lamp changes next to nothing."""
    optics = microscope(6.9, 60, 60)
    over = body("over", disc(13.0), 130.0, 0.0)
    kept = []
    for blur_um in (0.06, 0.12):  # below an eighth of the points' distance, and above
        lamp = blur_um / 130
        (light,) = irradiances(
            (over,), (0.0,), optics, lamp_aperture=lamp, focus_um=(0.0,)
        )
        (shade,) = light.shades
        kept.append(shade.kept)
        assert shade.kept.sum() * shade.lattice.step_um**2 == pytest.approx(
            math.pi * 13.0**2, rel=1e-3
        )  # the area of the shadow; bands err by 1e-3
    # a blur of .12 um spreads an edge over squares of .54 um by a ninth of them at most
    assert np.abs(kept[1] - kept[0]).max() < 0.12 / 0.54 / 2 + 1e-3


@pytest.mark.parametrize("lamp", [0.42, 0.2])
def test_a_bores_floor_is_shaded_once_more_than_it_is_hidden(lamp: float) -> None:
    optics = microscope(6.9, 3, 3)
    layers = (plate(25.0, 100.0),)
    scene = Scene(layers=layers, background=0.75, background_z_um=0.0)
    found = render_coaxial(scene, optics, focus_um=0.0, lamp_aperture=lamp)
    hidden = render(scene, optics, focus_um=0.0)
    once = bore_brightness(25.0, 100.0, replace(optics, aperture=lamp))
    # as above, twice: the image is blurred as well
    assert abs(found[1, 1] / hidden[1, 1] - once) < 0.01
    twice = bore_brightness(25.0, 100.0, optics, lamp_aperture=lamp)
    # the law's rings about the rim of the bore change what is hidden, too: .004 at 100
    assert abs(found[1, 1] - 0.75 * twice) < 0.75 * 0.01


def test_nothing_higher_is_rendered_bit_by_bit() -> None:
    optics = microscope(6.9, 40, 30)
    scenes = (
        Scene(layers=(body("part", gear(), 0.0, 0.8),), background=0.3),
        Scene(layers=(), background=0.3, background_z_um=0.0),
        Scene(
            layers=(
                body("left", rectangle(-50, -50, -5, 50), 0.0, 0.8),
                body("right", rectangle(5, -50, 50, 50), 0.0, 0.5),
            ),
            background=0.3,
            background_z_um=0.0,
        ),
        # the lower body is not in view, the higher one shades it alone
        Scene(
            layers=(
                body("far", disc(10.0, (2000.0, 0.0)), -50.0, 1.0),
                body("near", disc(10.0), 0.0, 0.5),
            ),
            background=0.3,
        ),
    )
    light = Illumination(gain=0.9, gradient_x=0.2)
    for scene in scenes:
        found = render_coaxial(
            scene, optics, focus_um=4.0, lamp_aperture=LAMP, light=light
        )
        plain = render(scene, optics, focus_um=4.0, light=light)
        assert np.array_equal(found, plain)
        assert shade_error(scene, optics, focus_um=4.0, lamp_aperture=LAMP) == 0


def test_a_background_is_shaded_as_a_wide_layer() -> None:
    optics = microscope(6.9, 60, 40)
    floor = body("floor", rectangle(-1e3, -1e3, 1e3, 1e3), 0.0, 0.1)
    scene = grasp(0.0)
    laid = Scene(layers=(floor, *scene.layers), background=0.0)
    for focus_um in (100.0, 0.0):
        one = render_coaxial(scene, optics, focus_um=focus_um, lamp_aperture=LAMP)
        other = render_coaxial(laid, optics, focus_um=focus_um, lamp_aperture=LAMP)
        # rays are summed in single precision, of which a hundred round apart
        atol = float(np.sqrt(100) * np.finfo(np.float32).eps)
        np.testing.assert_allclose(one, other, rtol=0, atol=atol)


def _in_lamplight(
    scene: Scene,
    optics: Microscope,
    focus_um: float = 100.0,
    *,
    window: Window | None = None,
    also: Sequence[Covered] = (),
    under: Sequence[Irradiance] | None = None,
) -> FloatArray:
    """Return an image in the usual light."""
    return render_coaxial(
        scene,
        optics,
        focus_um=focus_um,
        lamp_aperture=LAMP,
        window=window,
        also=also,
        under=under,
    )


def test_lights_of_what_stands_still_serve_many_images() -> None:
    optics = microscope(6.9, 60, 40)
    scene = grasp(0.0)
    moving, *still = scene.layers
    heights = (0.0, 100.0, 230.0)
    under = irradiances(
        still, heights, optics, lamp_aperture=LAMP, focus_um=(90.0, 110.0)
    )
    bare = replace(scene, layers=(replace(moving, outline=place(gear(), 4.0, 1.0)),))
    for focus_um in (90.0, 103.0):
        also = cover(still, optics, focus_um=focus_um)
        one = _in_lamplight(bare, optics, focus_um, also=also, under=under)
        other = _in_lamplight(bare, optics, focus_um, also=also)
        # lattices of another size are continued elsewhere by their mirror images
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-3)
        again = _in_lamplight(bare, optics, focus_um, also=also, under=under)
        assert np.array_equal(one, again)


def test_window_and_shift_move_the_light_too() -> None:
    optics = microscope(6.9, 60, 40)
    whole = _in_lamplight(grasp(0.0), optics)
    piece = Window(row=5, column=8, rows=20, columns=30)
    part = _in_lamplight(grasp(0.0), optics, window=piece)
    # what bands and margins of other tiles err by
    np.testing.assert_allclose(part, whole[5:25, 8:38], rtol=0, atol=1.5e-3)
    p = optics.um_per_px
    moved = render_coaxial(
        grasp(0.0),
        optics,
        focus_um=100.0,
        lamp_aperture=LAMP,
        shift_um=(2 * p, -p),
    )
    np.testing.assert_allclose(moved[1:, 2:], whole[:-1, :-2], rtol=0, atol=1.5e-3)


@pytest.mark.parametrize(("focus_um", "limit"), [(100.0, 0.003), (0.0, 0.01)])
def test_traced_images_have_the_same_shade(focus_um: float, limit: float) -> None:
    optics = microscope(6.9, 60, 50)
    floor = body("floor", rectangle(-400, -400, 400, 400), 0.0, 0.5)
    scene = Scene(layers=(floor, body("gear", gear(), 100.0, 0.8)), background=0.0)
    traced = occluded(scene, optics, focus_um=focus_um, lamp_aperture=LAMP)
    change = traced - occluded(scene, optics, focus_um=focus_um)
    found = _in_lamplight(scene, optics, focus_um)
    found = found - render(scene, optics, focus_um=focus_um)
    assert np.abs(change).max() > 0.1
    assert np.abs(found - change).max() < limit


@pytest.mark.parametrize(
    ("focus_um", "limit"), [(0.0, 0.004), (20.0, 0.004), (40.0, 0.004)]
)
def test_rays_counted_one_by_one_are_as_bright(focus_um: float, limit: float) -> None:
    # hardly any diffraction; a disc of 20 um over a stage 40 um below
    optics = replace(microscope(6.9, 61, 3), wavelength_um=0.05)
    over = body("over", disc(20.0), 40.0, 0.3)
    scene = Scene(layers=(over,), background=0.8, background_z_um=0.0)
    found = render_coaxial(scene, optics, focus_um=focus_um, lamp_aperture=LAMP)
    rng, count = np.random.default_rng(3), 40_000
    for column in (2, 9, 14, 19, 24, 30):
        x = (column - 30 + rng.uniform(-0.5, 0.5, count)) * optics.um_per_px
        y = rng.uniform(-0.5, 0.5, count) * optics.um_per_px
        up, down = _pupil(optics, rng, count), _pupil(optics, rng, count)
        floor = np.stack([x, y]) - focus_um * up  # where the stage is seen
        hides = np.hypot(x + (40 - focus_um) * up[0], y + (40 - focus_um) * up[1]) < 20
        dark = np.hypot(*(floor + 40 * down)) < 20
        counted = np.where(hides, 0.3, np.where(dark, 0.0, 0.8)).mean()
        noise = 3 * 0.4 / math.sqrt(count)
        assert abs(found[1, column] - counted) < noise + limit


def _pupil(optics: Microscope, rng: np.random.Generator, count: int) -> FloatArray:
    """Return slopes (2, N) of rays at random in the pupil."""
    sine = optics.aperture * np.sqrt(rng.random(count))
    turn = 2 * np.pi * rng.random(count)
    slopes: FloatArray = (
        sine / np.sqrt(1 - sine**2) * np.stack([np.cos(turn), np.sin(turn)])
    )
    return slopes


def test_the_error_of_leaving_it_out_is_found() -> None:
    optics = microscope(6.9, 640, 480)
    for window in (None, Window(row=190, column=270, rows=100, columns=100)):
        told = shade_error(
            grasp(0.0), optics, focus_um=100.0, lamp_aperture=LAMP, window=window
        )
        plain = render(grasp(0.0), optics, focus_um=100.0, window=window)
        found = _in_lamplight(grasp(0.0), optics, window=window) - plain
        most = float(np.abs(found).max())
        assert 0.9 * most < told < 1.1 * most


@pytest.mark.parametrize(
    ("aperture", "lamp", "gap_um", "focus_um"),
    [
        (0.42, 1e-9, 1e-9, 0.0),
        (0.999, 1e-9, 30.0, 0.0),
        (0.999, 0.1, 1e6, 1e6),
        (0.05, 1e-9, 1e6, -5.0),
        (0.42, 0.999, 1e3, 1e3),
        (1e-3, 0.999, 1.0, 1e4),
    ],
)
def test_extremes_stay_between_dark_and_bright(
    aperture: float, lamp: float, gap_um: float, focus_um: float
) -> None:
    optics = replace(microscope(6.9, 30, 24), aperture=aperture)
    scene = Scene(
        layers=(
            body("low", disc(13.0), gap_um, 0.8),
            body("high", rectangle(-13, -13, 13, 0.3), gap_um * 1.01, 0.2),
        ),
        background=0.5,
        background_z_um=0.0,
    )
    found = render_coaxial(scene, optics, focus_um=focus_um, lamp_aperture=lamp)
    plain = render(scene, optics, focus_um=focus_um)
    assert np.isfinite(found).all()
    # beyond black and white by what bands, margins and rays err
    assert found.min() > -0.01
    assert found.max() < 0.81
    # shade takes light away; where bodies touch, blending errs by more than that
    assert gap_um < 1 or (found - plain).max() < 0.01


def test_refusals_say_what_must_hold() -> None:
    optics, scene = microscope(6.9, 20, 20), grasp(0.0)
    with pytest.raises(ValueError, match="aperture must be below medium_index"):
        render_coaxial(scene, optics, focus_um=0.0, lamp_aperture=1.0)
    with pytest.raises(ValueError, match="aperture must be positive"):
        render_coaxial(scene, optics, focus_um=0.0, lamp_aperture=0.0)
    under = irradiances((), (0.0,), optics, lamp_aperture=LAMP, focus_um=(0.0,))
    with pytest.raises(ValueError, match="under must hold heights"):
        render_coaxial(scene, optics, focus_um=0.0, lamp_aperture=LAMP, under=under)
    under = irradiances(
        scene.layers, (0.0, 100.0, 230.0), optics, lamp_aperture=LAMP, focus_um=(0.0,)
    )
    with pytest.raises(ValueError, match="so wide a window or defocus"):
        render_coaxial(
            replace(scene, layers=()),
            optics,
            focus_um=400.0,
            lamp_aperture=LAMP,
            also=cover(scene.layers, optics, focus_um=400.0),
            under=under,
        )
    with pytest.raises(ValueError, match="background_z_um must be finite"):
        Scene(layers=(), background=0.0, background_z_um=math.inf)
