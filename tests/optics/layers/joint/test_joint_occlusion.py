"""Means of products over rays: against rays counted one by one, and where none are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.optics.layers.joint.joint_faces import JointFace
from microplan.optics.layers.joint.joint_occlusion import joint_residual, ray_count
from microplan.optics.layers.lattice import Lattice
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shaded_view import ShadedView
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.render.render import cover, render
from microplan.optics.render.scene import Layer, Scene, Window
from tests.optics.shapes import disc, gear, microscope, rectangle

WINDOW = Window(row=44, column=64, rows=32, columns=32)
LAMP = 0.42


def body(name: str, x_um: float, z_um: float, reflectance: float = 0.7) -> Layer:
    """Return a plate to the right of x."""
    outline = rectangle(x_um, -60, x_um + 600, 600)
    return Layer(name=name, outline=outline, z_um=z_um, reflectance=reflectance)


def over_shaft() -> Scene:
    """Return a post under a gear and two fingers, over the stage."""
    return Scene(
        layers=(
            Layer(name="stage", outline=rectangle(-2e3, -2e3, 2e3, 2e3),
                  z_um=-250.0, reflectance=0.1),
            Layer(name="post", outline=disc(22.0), z_um=0.0, reflectance=0.75),
            Layer(name="gear", outline=gear(), z_um=110.0, reflectance=0.8),
            body("right", 48.0, 250.0),
        ),
        background=0.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("focus_um", "worst", "rms"), [(0.0, 0.01, 0.0025), (4.0, 0.012, 0.003)]
)
def test_two_bodies_far_above_hide_the_same_rays(
    focus_um: float, worst: float, rms: float
) -> None:
    """The tracer has 400 rays: means over those err by .0015, cells by as much."""
    optics = microscope()
    scene = replace(over_shaft(), layers=over_shaft().layers[1:])  # without the stage
    small = Window(row=54, column=80, rows=12, columns=16)
    traced = occluded(
        scene, optics, focus_um=focus_um, window=small, samples=400, step_um=1.1,
        lamp_aperture=LAMP,
    )  # fmt: skip
    found = render_coaxial(
        scene, optics, focus_um=focus_um, lamp_aperture=LAMP, window=small
    )
    off = found - traced
    assert np.abs(off).max() < worst
    assert np.sqrt(np.mean(off**2)) < rms


def test_one_body_out_of_focus_leaves_nothing_to_trace() -> None:
    """Bit by bit: what is in focus, or even, multiplies."""
    optics = microscope()
    wide = Layer(name="bed", outline=rectangle(-2e3, -2e3, 2e3, 2e3), z_um=-90.0,
                 reflectance=0.3)  # fmt: skip
    post = Layer(name="post", outline=disc(12.0), z_um=0.0, reflectance=0.8)
    for layers in ((post, body("a", 5.0, 80.0)), (wide, post, body("a", 5.0, 80.0))):
        scene = Scene(layers=layers, background=0.2)
        plain = render(scene, optics, focus_um=0.0, window=WINDOW)
        same = render_coaxial(
            scene, optics, focus_um=0.0, lamp_aperture=None, window=WINDOW
        )
        np.testing.assert_array_equal(plain, same)


def joint_scene() -> tuple[list[JointFace], Lattice]:
    """Return the faces over a shaft, and the points that rays come from."""
    optics, scene = microscope(), over_shaft()
    view = ShadedView(
        microscope=optics, focus_um=0.0, model="exact", frame=WINDOW, shift_um=(0, 0)
    )
    seen = cover(scene.layers, optics, focus_um=0.0, window=WINDOW)
    return view.joint_faces(scene, seen, {}, 5.0)


def test_two_patterns_of_rays_differ_by_little() -> None:
    """Turned by half the golden angle; the aims are .003 and .001 rms."""
    faces, lattice = joint_scene()
    one, other = (
        joint_residual(
            faces, lattice, microscope(), rays=ray_count(lattice, 1.0), spin_rad=spin
        )
        for spin in (0.0, 1.2)
    )
    assert one is not None
    assert other is not None
    post = 0.75 - 0.1
    for a, b in (
        (one.above, other.above),
        (post * one.sharp[0], post * other.sharp[0]),
    ):
        assert np.abs(a - b).max() < 0.003
        assert np.sqrt(np.mean((a - b) ** 2)) < 0.001
    assert max(np.abs(f).max() for f in (one.above, *one.sharp)) > 0.02


def test_fewer_rays_differ_by_little() -> None:
    """256 a point in place of 1024."""
    faces, lattice = joint_scene()
    usual, few = (
        joint_residual(faces, lattice, microscope(), rays=ray_count(lattice, finer))
        for finer in (1.0, 0.3)
    )
    assert usual is not None
    assert few is not None
    off = np.abs(usual.above - few.above)
    assert 0 < off.max() < 0.003
    assert np.sqrt(np.mean(off**2)) < 0.001


def test_a_body_that_hides_all_leaves_what_lies_below_out() -> None:
    optics = microscope()
    lid = Layer(name="lid", outline=rectangle(-2e3, -2e3, 2e3, 2e3), z_um=300.0,
                reflectance=0.4)  # fmt: skip
    scene = replace(over_shaft(), layers=(*over_shaft().layers, lid))
    found = render_coaxial(
        scene, optics, focus_um=0.0, lamp_aperture=LAMP, window=WINDOW
    )
    np.testing.assert_allclose(found, 0.4, atol=1e-3)


@pytest.mark.parametrize(
    ("side", "finer", "rays"),
    [(20, 1.0, 1024), (100, 1.0, 128), (400, 1.0, 64),
     (20, 0.5, 512), (100, 0.5, 64), (200, 0.5, 32), (400, 0.5, 16)],
)  # fmt: skip
def test_trials_have_fewer_rays_the_more_points_there_are(
    side: int, finer: float, rays: int
) -> None:
    lattice = Lattice(
        step_um=1.0, window=Window(row=0, column=0, rows=side, columns=side)
    )
    assert ray_count(lattice, finer) == rays
    assert ray_count(lattice, 2.0) == ray_count(lattice, 1.0)
