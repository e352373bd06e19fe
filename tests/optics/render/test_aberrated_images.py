"""Images through a lens with a wavefront error, against those of another author."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely.affinity import translate
from shapely.geometry import Polygon

from microplan.optics.render.prepared_scene import prepare
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.render.view_range import Range
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.wavefront import disc_shift_um, most_defocus_um
from tests.optics.shapes import microscope, polygon
from validation.twins import optics, scenes

POINTS = [(-8.0, -6.0), (9.0, -6.0), (9.0, 5.0), (-3.0, 5.0), (-3.0, 1.0), (-8.0, 1.0)]
SCOPE = replace(microscope(20.0, width_px=72, height_px=56), pitch_um=8.0)
PITCH, SIZE = 0.4, (56, 72)


def ours(terms: Terms, z_um: float) -> np.ndarray:
    layer = Layer(name="a", outline=polygon(POINTS), z_um=z_um, reflectance=0.8)
    scope = replace(SCOPE, wavefront=terms)
    return render(Scene(layers=(layer,), background=0.1), scope, focus_um=0.0)


def twin(terms: Terms, z_um: float, off_um: tuple[float, float]) -> np.ndarray:
    shape = translate(Polygon(POINTS), *off_um)
    body = scenes.Body(shape=shape, reflectance=0.8, z_um=z_um)
    lens = optics.Optics(aperture=0.42, wavelength_um=0.6, zernike=dict(terms))
    return optics.image(scenes.Scene(bodies=(body,), background=0.1), lens, SIZE, PITCH)


@pytest.mark.parametrize("z_um", [0.0, 2.0, -6.0])
@pytest.mark.parametrize("terms", [((8, 0.05),), ((7, -0.04), (5, 0.03), (11, 0.05))])
def test_the_change_is_the_twins(terms: Terms, z_um: float) -> None:
    """But for the displacement of discs in focus, which a calibration takes off."""
    x_um, y_um = disc_shift_um(replace(SCOPE, wavefront=terms))
    wanted = twin(terms, z_um, (-x_um, -y_um)) - twin((), z_um, (0.0, 0.0))
    found = ours(terms, z_um) - ours((), z_um)
    assert (found - wanted).std() < 0.02 * wanted.std()


def test_coma_the_other_way_moves_to_the_other_side() -> None:
    """A disc out of focus: what it moves by against one in focus changes its sign."""
    x = np.arange(SIZE[1]) - (SIZE[1] - 1) / 2
    moved = []
    for waves in (0.05, -0.05):
        image = ours(((8, waves),), 4.0) - ours((), 4.0)
        moved.append(float((image @ x).sum()))
    assert moved[0] == pytest.approx(-moved[1], rel=0.05)
    assert abs(moved[0]) > 1e-3


def test_no_terms_and_terms_of_nothing_give_the_same_image() -> None:
    np.testing.assert_allclose(ours(((8, 0.0),), 1.0), ours((), 1.0), atol=1e-12)


def test_a_body_far_out_of_focus_is_left_as_it_is() -> None:
    far_um = 1.01 * most_defocus_um(SCOPE)
    np.testing.assert_array_equal(ours(((8, 0.05),), far_um), ours((), far_um))


@pytest.mark.parametrize("zoom", [1.0, 1.01])
def test_a_prepared_scene_shows_the_same_image(zoom: float) -> None:
    """Planes on both sides of a body are two images, unlike those of a plain lens."""
    layer = Layer(name="a", outline=polygon(POINTS), z_um=0.0, reflectance=0.8)
    scene = Scene(layers=(layer,), background=0.1)
    scope = replace(SCOPE, wavefront=((8, 0.05), (11, 0.06)))
    ready = prepare(
        scene, scope, Range(focus_um=(-3.0, 3.0), shift_um=1.0, zoom=(0.98, 1.02))
    )
    there = replace(scope, magnification=scope.magnification * zoom)
    images = []
    for focus_um in (2.0, -2.0):
        found = ready.image(focus_um=focus_um, zoom=zoom)
        wanted = render(scene, there, focus_um=focus_um)
        np.testing.assert_allclose(found, wanted, atol=1e-3)  # band and margin
        images.append(found)
    assert np.abs(images[0] - images[1]).max() > 0.02
