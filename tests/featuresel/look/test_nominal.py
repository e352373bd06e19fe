"""The renderer that routines prepare with: the target alone, and what hides it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import (
    Backdrop,
    moved_layers,
    render_look,
    scene,
)
from microplan.featuresel.look.static_layers import fresh
from microplan.optics.layers.occlusion import occluded
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Illumination, Layer
from microplan.optics.transfer.microscope import Terms
from tests.featuresel.conftest import disc, post_layer
from tests.featuresel.fits import case, render
from tests.featuresel.sharing import FINE, SHARED

# of full scale: each image's own error, of band and margin; see `render.sampling`
RENDER = 2e-4


def collected(template: FloatArray, over: int) -> FloatArray:
    """Return the light of whole pixels, from samples finer than the optics resolve."""
    fy = np.fft.fftfreq(template.shape[0])[:, None]
    fx = np.fft.rfftfreq(template.shape[1])
    light = np.fft.rfft2(template) * np.sinc(over * fy) * np.sinc(over * fx)
    return np.fft.irfft2(light, s=template.shape)[::over, ::over]


@pytest.mark.parametrize("terms", [(), ((8, 0.1), (5, 0.05))])
@pytest.mark.parametrize("z_um", [0.0, 6.0])
def test_a_template_is_the_image_without_pixels_area(z_um: float, terms: Terms) -> None:
    """Coma moves what finer pixels show by .05 um less, were they the camera's."""
    seen, half = case("post"), (45, 40)
    scope = replace(seen.microscope, wavefront=terms)
    look, target = nominal_render(replace(seen, microscope=scope)), seen.target
    (template,) = look.template((z_um,), over=3, half_px=half)
    assert template.shape == (2 * 3 * half[1] + 1, 2 * 3 * half[0] + 1)
    top, left = round(target.row) - half[1], round(target.column) - half[0]
    image = look(dz_um=z_um)[top : top + 2 * half[1] + 1, left : left + 2 * half[0] + 1]
    found = collected(template, 3)
    # borders are dark and even: what comes in from across is alike
    np.testing.assert_allclose(found, image, atol=2 * RENDER)


def test_all_heights_at_once_are_each_alone() -> None:
    heights, half = (-4.0, 0.0, 7.0), (40, 40)
    stack = render("post").template(heights, over=3, half_px=half)
    for dz_um, plane in zip(heights, stack, strict=True):
        (one,) = render("post").template((dz_um,), over=3, half_px=half)
        np.testing.assert_allclose(plane, one, atol=2 * RENDER)


def test_a_template_leaves_out_what_stands_still_and_the_lights_gradient() -> None:
    shown = case("over_shaft")
    tilted = replace(shown, light=Illumination(gain=0.8, gradient_x=0.3))
    bare = replace(shown, static=(), light=Illumination(gain=0.8))
    half = (40, 40)
    found, expected = (
        nominal_render(c).template((0.0,), over=3, half_px=half) for c in (tilted, bare)
    )
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("over", [-1, 0, 2])
def test_a_template_needs_a_sample_at_the_pixels_centres(over: int) -> None:
    with pytest.raises(ValueError, match="odd"):
        render("post").template((0.0,), over=over, half_px=(9, 9))


def test_alone_is_the_image_where_nothing_else_is() -> None:
    at = {"dx_um": 1.3, "dy_um": -0.4, "dz_um": 3.0}
    np.testing.assert_array_equal(render("post").alone(**at), render("post")(**at))
    hidden = render("over_shaft")
    post = Outline(rings=(disc(22),))
    assert [layer.outline for layer in hidden.case.moving] == [post]
    np.testing.assert_array_equal(
        hidden.alone(**at),
        nominal_render(replace(hidden.case, static=()))(**at),
    )


@pytest.mark.parametrize("gain", [1.0, 0.7])
@pytest.mark.parametrize("z_um", [0.0, -6.0])
def test_an_image_is_the_target_alone_behind_its_veil(gain: float, z_um: float) -> None:
    """In focus; else as rays that pass the veil meet other parts of a target's edge.

    By rays through cells; each road's own error is .003 at most.
    """
    shown = replace(case("over_shaft"), light=Illumination(gain=gain))
    look = nominal_render(shown)
    occluders = look.occluders(z_um)
    alone = look.alone(dx_um=2.0, dz_um=z_um)
    image = look(dx_um=2.0, dz_um=z_um)
    off = np.abs(occluders.light + occluders.through * alone - image)
    assert np.median(off) < RENDER  # but at the edge they are the same
    if z_um == 0:
        assert off.max() < RENDER
        return
    traced = occluded(
        scene(shown, 2.0, 0.0, 0.0),
        shown.microscope,
        focus_um=shown.focus_um + z_um,
        model=shown.model,
        window=shown.window,
        light=shown.light,
        samples=1024,
        step_um=0.27,
    )
    assert off.max() > 0.02 * gain  # what the product leaves out
    np.testing.assert_allclose(image, traced, rtol=0, atol=2 * 0.003)


def test_nothing_in_front_is_no_veil() -> None:
    below = Layer(
        name="bed", outline=Outline(rings=(disc(80),)), z_um=-30.0, reflectance=0.4
    )
    for shown in (case("post"), replace(case("post"), static=(below,))):
        occluders = nominal_render(shown).occluders()
        assert (occluders.light == 0).all()
        assert (occluders.through == 1).all()


def test_a_veil_hides_all_below_it_and_nothing_beside_it() -> None:
    lid = replace(post_layer(20.0), name="lid", reflectance=0.6)
    occluders = nominal_render(replace(case("post"), static=(lid,))).occluders()
    # 20 um above focus a point's rays come from within 9.3 um; of diffraction's light
    # the share wavelength / (pi**2 A d) comes from farther than d beyond that
    for column, hides, away_um in ((100, 1.0, 22 - 9.3), (160, 0.0, 65 - 22 - 9.3)):
        tail = 0.6 / (math.pi**2 * 0.42 * away_um)
        assert occluders.through[100, column] == pytest.approx(1 - hides, abs=tail)
        assert occluders.light[100, column] == pytest.approx(0.6 * hides, abs=tail)
    assert (occluders.through > -0.01).all()
    assert (occluders.through < 1.01).all()


def test_what_is_kept_changes_no_image() -> None:
    lit = replace(case("over_shaft"), lamp_aperture=0.3, sampling=FINE)
    look = nominal_render(lit)
    asked = [(0.3, 0.0), (-0.3, 0.0), (0.3, 4.0), (0.3, 8.0), (0.3, -4.0), (0.3, 2.0)]
    first = [look(dx_um=x, dz_um=z) for x, z in asked]
    for (x, z), image in zip(asked, first, strict=True):
        there = replace(lit, focus_um=lit.focus_um + z)
        still = Backdrop(fresh(there, lit.static).layers)  # the light is computed
        anew = render_look(there, moved_layers(lit, x, 0.0, 0.0), still)
        np.testing.assert_allclose(image, np.clip(anew, 0, 1), rtol=0, atol=SHARED)
    first[0][...] = 0.0
    assert look(dx_um=0.3).max() > 0
    np.testing.assert_array_equal(look(dx_um=-0.3), first[1])
