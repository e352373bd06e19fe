"""What walls that mirror hide of the error of leaving shade out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.optics.layers.shading import shade_error
from microplan.optics.layers.wall_error import most_shade_error
from microplan.optics.render.scene import Layer, Scene
from tests.optics.shapes import disc, microscope, rectangle

LAMP = 0.42


def beside_a_block(wall: float) -> Scene:
    """Return a disc in focus beside a higher block."""
    layers = (
        Layer(name="disc", outline=disc(10.0), z_um=0.0, reflectance=0.7),
        Layer(
            name="block", outline=rectangle(14, -200, 300, 200), z_um=60.0,
            reflectance=0.3, underside_um=0.0, wall_reflectance=wall,
        ),
    )  # fmt: skip
    return Scene(layers=layers, background=0.1, background_z_um=0.0)


@pytest.mark.parametrize("wall", [0.0, 0.6, 1.0])
def test_mirrors_make_no_shade_negligible(wall: float) -> None:
    optics = microscope(6.9, 60, 60)
    scene, black = beside_a_block(wall), beside_a_block(0.0)
    found = most_shade_error(scene, optics, focus_um=0.0, lamp_aperture=LAMP)
    dark = shade_error(black, optics, focus_um=0.0, lamp_aperture=LAMP)
    own = shade_error(scene, optics, focus_um=0.0, lamp_aperture=LAMP)
    assert found == max(dark, own)
    assert dark > 0.05  # the block takes light from the disc


def test_black_walls_have_one_error() -> None:
    optics = microscope(6.9, 60, 60)
    scene = beside_a_block(0.0)
    layers = tuple(replace(each, wall_reflectance=0.0) for each in scene.layers)
    assert layers == scene.layers
    assert most_shade_error(
        scene, optics, focus_um=0.0, lamp_aperture=LAMP
    ) == shade_error(scene, optics, focus_um=0.0, lamp_aperture=LAMP)
