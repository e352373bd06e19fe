"""Mirror faces below other bodies against rays counted one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.layers.mirrors.images import mirror_images
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer, Scene
from tests.optics.shapes import circle, disc, microscope, rectangle

LENS = LAMP = 0.42
HIGH_UM, RADIUS_UM = 100.0, 25.0
FACE = 0.8
# hardly any diffraction
OPTICS = replace(microscope(6.9, 41, 3), wavelength_um=0.05)
COLUMNS = (4, 12, 20, 26, 31)
# Rays a pixel that are lit: their mean errs by .8 / 2 / sqrt(COUNT), .003, at most
COUNT = 20_000


def under_a_bore(finish: float, at_um: tuple[float, float] = (0.0, 0.0)) -> Scene:
    """Return a bed 100 um below a dark plate with a round bore."""
    outer = rectangle(-300, -300, 300, 300)
    ring = circle(RADIUS_UM, at_um, hole=True)
    return Scene(
        layers=(
            Layer(name="bed", outline=outer, z_um=0.0, reflectance=FACE, finish=finish),
            Layer(name="plate", outline=Outline(rings=(*outer.rings, ring)),
                  z_um=HIGH_UM, reflectance=0.0),
        ),
        background=0.0,
    )  # fmt: skip


def counted(
    finish: float,
    focus_um: float,
    at_um: tuple[float, float],
    column: int,
    aperture: float,
) -> float:
    """Return what rays find one by one that come out of the bore at a pixel.

    A mirror sends back along a slope what the lamp's cone has of it, and in all as
    much as a dull face.
    """
    rng = np.random.default_rng(column)
    count = round(COUNT * (LENS / aperture) ** 2)
    p = OPTICS.um_per_px
    pixel = rng.uniform(-0.5, 0.5, (2, count)) * p
    pixel[0] += (column - 20) * p
    seen, lamp = _pupil(LENS, count, rng), _pupil(aperture, count, rng)
    bright = np.hypot(*seen) <= aperture / np.sqrt(1 - aperture**2)
    bed = pixel - focus_um * seen

    def passes(slopes: FloatArray) -> FloatArray:
        x, y = bed + HIGH_UM * slopes
        return np.asarray(np.hypot(x - at_um[0], y - at_um[1]) < RADIUS_UM)

    mirrored = bright / bright.mean() * passes(-seen)
    light = finish * mirrored + (1 - finish) * passes(lamp)
    return float(FACE * np.mean(passes(seen) * light))


def _pupil(aperture: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Return slopes (2, count) at random in a pupil."""
    sine = aperture * np.sqrt(rng.random(count))
    turn = 2 * np.pi * rng.random(count)
    tangent = sine / np.sqrt(1 - sine**2)
    return np.stack([tangent * np.cos(turn), tangent * np.sin(turn)])


@pytest.mark.parametrize(
    ("finish", "focus_um", "at_um", "lamp"),
    [(1.0, 0.0, (0.0, 0.0), LENS), (1.0, 0.0, (7.0, -4.0), LENS),
     (0.5, 0.0, (7.0, -4.0), LENS), (1.0, 60.0, (0.0, 0.0), LENS),
     (0.5, 60.0, (7.0, -4.0), LENS), (1.0, -40.0, (7.0, -4.0), LENS),
     (1.0, 0.0, (7.0, -4.0), 0.2), (1.0, 60.0, (7.0, -4.0), 0.2),
     (0.5, 60.0, (7.0, -4.0), 0.2), (1.0, -40.0, (7.0, -4.0), 0.1)],
)  # fmt: skip
def test_a_bed_below_a_bore_is_as_bright_as_rays_counted_one_by_one(
    finish: float, focus_um: float, at_um: tuple[float, float], lamp: float
) -> None:
    scene = under_a_bore(finish, at_um)
    found = render_coaxial(scene, OPTICS, focus_um=focus_um, lamp_aperture=lamp)
    traced = occluded(
        scene, OPTICS, focus_um=focus_um, lamp_aperture=lamp, step_um=0.75
    )
    truth = [counted(finish, focus_um, at_um, column, lamp) for column in COLUMNS]
    noise = 3 * 0.5 * FACE / np.sqrt(COUNT)
    # rays and lattices of the first as in test_shading, 256 rays of the other
    np.testing.assert_allclose(found[1, COLUMNS], truth, rtol=0, atol=noise + 0.004)
    np.testing.assert_allclose(traced[1, COLUMNS], truth, rtol=0, atol=noise + 0.012)


def test_an_image_lies_as_far_below_as_its_body_is_above() -> None:
    low, high, same = (
        Layer(name=name, outline=disc(5.0), z_um=z, reflectance=0.5, underside_um=0.0)
        for name, z in (("low", 30.0), ("high", 70.0), ("same", 30.0))
    )
    bed = Layer(name="bed", outline=disc(9.0), z_um=10.0, reflectance=0.5)
    images = mirror_images((high, bed, low, same), 10.0)
    assert [[each.z_um for each in group] for group in images] == [[-10, -10], [-50]]
    assert all(each.underside_um is None for group in images for each in group)


def test_a_mirror_that_nothing_stands_above_is_as_a_dull_face() -> None:
    part = Layer(name="part", outline=disc(9.0), z_um=10.0, reflectance=0.5)
    low = Layer(name="low", outline=disc(19.0), z_um=0.0, reflectance=0.3)
    dull, shiny = (
        render_coaxial(
            Scene(layers=(low, replace(part, finish=finish)), background=0.1),
            OPTICS, focus_um=4.0, lamp_aperture=LAMP,
        )
        for finish in (0.0, 1.0)
    )  # fmt: skip
    np.testing.assert_array_equal(dull, shiny)
