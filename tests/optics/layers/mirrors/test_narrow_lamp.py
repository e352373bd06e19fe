"""Mirrors under a lamp that is narrower than the lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.layers.coaxial_light import irradiances
from microplan.optics.layers.mirrors.narrow_lamp import LitPart, lit_parts
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.render.render import cover
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, gear, microscope, rectangle

LENS = 0.42
OPTICS = microscope()


def stacked(finish: float) -> Scene:
    """Return a disc above a gear that is polished, both flat."""
    return Scene(
        layers=(
            Layer(name="gear", outline=gear(), z_um=0.0, reflectance=0.8,
                  finish=finish),
            Layer(name="disc", outline=disc(20.0, (30.0, 5.0)), z_um=80.0,
                  reflectance=0.5),
        ),
        background=0.1, background_z_um=-50.0,
    )  # fmt: skip


def image(scene: Scene, lamp: float, focus_um: float = 0.0) -> FloatArray:
    """Return the whole frame."""
    return render_coaxial(scene, OPTICS, focus_um=focus_um, lamp_aperture=lamp)


@pytest.mark.parametrize(
    ("finish", "lamp"),
    [(1.0, LENS), (1.0, LENS * (1 - 1e-12)), (1.0, 0.6), (1.0, None), (0.0, 0.1)],
)
def test_a_lamp_as_wide_as_the_lens_or_no_mirror_leaves_a_scene_whole(
    finish: float, lamp: float | None
) -> None:
    whole = LitPart(scene=stacked(finish), microscope=OPTICS)
    (found,) = lit_parts(whole, lamp, lambda *_: ())
    assert found is whole


def test_what_dull_faces_and_mirrors_send_is_what_layers_send() -> None:
    whole = LitPart(scene=stacked(0.3), microscope=OPTICS)
    dull, shiny = lit_parts(whole, 0.2, lambda *_: ())
    for given, one, other in zip(
        whole.scene.layers, dull.scene.layers, shiny.scene.layers, strict=True
    ):
        assert (one.finish, other.finish) == (0, 1)
        np.testing.assert_allclose(
            [one.reflectance, other.reflectance],
            given.reflectance * np.array([1 - given.finish, given.finish]),
        )
    assert (dull.scene.background, shiny.scene.background) == (0.1, 0.0)
    assert (dull.microscope, shiny.microscope.cone_aperture) == (OPTICS, 0.2)


def test_a_lamp_hardly_narrower_changes_hardly_anything() -> None:
    """Each image errs by .004 by its lattices, see test_images."""
    scene = stacked(1.0)
    apart = image(scene, LENS * 0.999, 20.0) - image(scene, LENS, 20.0)
    assert np.abs(apart).max() < 2 * 0.004
    assert np.abs(image(scene, 0.2, 20.0) - image(scene, LENS, 20.0)).max() > 0.1


def test_layers_blurred_already_are_seen_as_those_of_the_scene() -> None:
    scene = stacked(0.6)
    bare = replace(scene, layers=())
    still = cover(scene.layers, OPTICS, focus_um=10.0)
    under = irradiances(
        scene.layers, (0.0, -50.0, 80.0), OPTICS, lamp_aperture=0.2, focus_um=(10.0,)
    )
    found = render_coaxial(
        bare, OPTICS, focus_um=10.0, lamp_aperture=0.2, also=still, under=under
    )
    np.testing.assert_allclose(found, image(scene, 0.2, 10.0), rtol=0, atol=1e-9)


def edge(focus_um: float, optics: Microscope, finish: float) -> FloatArray:
    """Return the middle row of a half plane of .8 at 0, under a lamp of .2."""
    shown = render_coaxial(
        half_plane(finish), optics, focus_um=focus_um, lamp_aperture=0.2
    )
    middle: FloatArray = shown[optics.height_px // 2]
    return middle


def half_plane(finish: float) -> Scene:
    """Return what is bright left of 0, over black."""
    outline = rectangle(-300, -300, 0, 300)
    half = Layer(name="half", outline=outline, z_um=0.0, reflectance=0.8, finish=finish)
    return Scene(layers=(half,), background=0.0)


def test_a_mirror_alone_is_as_bright_as_a_dull_face_and_less_blurred() -> None:
    """Far from focus a pixel sees the lamp's disc up to a chord of it.

    Transfers of narrow lamps err by .006 of those of rays.
    """
    fine = replace(microscope(20.0, 80, 3), wavelength_um=0.05)
    radius_um = 30.0 * 0.2 / np.sqrt(1 - 0.2**2)
    x = (np.arange(80) - 39.5) * fine.um_per_px
    t = np.clip(x / radius_um, -1.0, 1.0)
    beyond = (np.arccos(t) - t * np.sqrt(1 - t**2)) / np.pi
    np.testing.assert_allclose(edge(30.0, fine, 1.0), 0.8 * beyond, rtol=0, atol=0.006)
    dull = edge(30.0, fine, 0.0)
    assert np.abs(dull - 0.8 * beyond).max() > 0.1
    np.testing.assert_allclose(edge(0.0, fine, 1.0)[:30], 0.8, atol=0.006)


def test_a_mirrors_edge_is_nearly_that_of_waves_from_points_of_the_lamp() -> None:
    """Abbe's sum over the lamp, which strong edges leave less than dull faces do."""
    fine = microscope(20.0, 50, 3)
    truth = render_coherent(
        half_plane(1.0), fine, focus_um=10.0, coherence=0.2 / LENS, samples=8
    )[1]
    mirror, dull = (
        np.sqrt(np.mean((edge(10.0, fine, finish) - truth) ** 2))
        for finish in (1.0, 0.0)
    )
    assert mirror < dull / 2
