"""Layers read from planes, against transforms of each layer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render import plane_reading
from microplan.optics.render.plane_reading import read_layer
from microplan.optics.render.render import cover
from microplan.optics.render.sampling import BAND_ERROR, Sampling
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, gear, microscope, rectangle

SCOPE = replace(microscope(7.0, width_px=640, height_px=480), pitch_um=7.6)
WINDOW = Window(row=200, column=280, rows=64, columns=80)
USUAL = Sampling(single=True, margin=80.0)
ROUGH = Sampling(band_error=2e-3, margin=12.0, near=12.0, single=True)
BODIES = {
    "gear": gear(),
    "finger": rectangle(-160.0, -10.0, 0.0, 20000.0),
    "post": disc(22.0, (3.0, -4.0)),
    "plate": rectangle(-350.0, -350.0, 350.0, 350.0),
}


def poses(outline: Outline, count: int) -> list[tuple[Outline, float, Microscope]]:
    """Return placed outlines, changes of defocus, um, and zoomed settings."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(count):
        x, y, turn = *rng.normal(0, 6, 2), rng.uniform(-math.pi, math.pi)
        zoom = SCOPE.magnification * (1 + rng.normal(0, 0.01))
        scope = replace(SCOPE, magnification=zoom)
        found.append((place(outline, x, y, turn), rng.uniform(-8, 8), scope))
    return found


def both(
    outline: Outline,
    z_um: float,
    scope: Microscope = SCOPE,
    sampling: Sampling = USUAL,
    model: str = "stokseth",
) -> tuple[FloatArray | None, FloatArray]:
    """Return a layer read from planes, and by a transform of its own."""
    layer = Layer(name="a", outline=outline, z_um=z_um, reflectance=1.0)
    read = read_layer(
        layer, scope, focus_um=0.0, model=model, window=WINDOW,
        shift_um=(1.3, -0.4), sampling=sampling,
    )  # fmt: skip
    (covered,) = cover(
        (layer,), scope, focus_um=0.0, model=model, window=WINDOW,
        shift_um=(1.3, -0.4), sampling=sampling,
    )  # fmt: skip
    return read, covered.coverage


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("z_um", [16.0, 30.0, -110.0, -330.0])
def test_a_plane_and_a_transform_differ_by_the_band_error(
    name: str, z_um: float
) -> None:
    for outline, dz_um, scope in poses(BODIES[name], 3):
        read, wanted = both(outline, z_um + dz_um, scope)
        assert read is not None
        np.testing.assert_allclose(read, wanted, rtol=0, atol=BAND_ERROR)


@pytest.mark.parametrize("model", ["exact", "hopkins", "geometric"])
def test_other_laws_are_read_as_well(model: str) -> None:
    for outline, dz_um, scope in poses(gear(), 2):
        read, wanted = both(outline, 130 + dz_um, scope, model=model)
        if read is not None:
            np.testing.assert_allclose(read, wanted, rtol=0, atol=BAND_ERROR)


@pytest.mark.parametrize("z_um", [-140.0, -350.0])
def test_a_rough_plane_is_as_good_as_a_rough_transform(z_um: float) -> None:
    for outline, dz_um, scope in poses(gear(), 3):
        read, _ = both(outline, z_um + dz_um, scope, ROUGH)
        rough, wanted = (both(outline, z_um + dz_um, scope, sampling)[1]
                         for sampling in (ROUGH, Sampling()))  # fmt: skip
        assert read is not None
        least = ROUGH.band_error / 2  # of which neither uses all here
        assert np.abs(read - wanted).max() < np.abs(rough - wanted).max() + least


def test_points_far_apart_are_read_as_pixels_are() -> None:
    """As lights on a face are, by samples much closer than the points."""
    points = replace(SCOPE, magnification=1.0, fill_factor=1e-9)
    read, wanted = both(gear(), 90.0, points)
    assert read is not None
    np.testing.assert_allclose(read, wanted, rtol=0, atol=BAND_ERROR)


def test_what_is_kept_changes_nothing() -> None:
    first = [both(*pose[:1], 140 + pose[1], pose[2])[0] for pose in poses(gear(), 4)]
    plane_reading._PLANES._held.clear()
    plane_reading._PLANES._bytes.clear()
    again = [
        both(*pose[:1], 140 + pose[1], pose[2])[0] for pose in poses(gear(), 4)[::-1]
    ]
    for one, other in zip(first, again[::-1], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_body_that_only_moves_shares_planes() -> None:
    plane_reading._PLANES._held.clear()
    plane_reading._PLANES._bytes.clear()
    for turn in np.linspace(0, 6, 13):
        both(place(gear(), 4 * math.cos(turn), 3.0, turn), 140.0)
    assert len(plane_reading._PLANES._held) <= 4 * 4  # heights, windows


def test_planes_do_not_serve_lenses_that_are_not_round_nor_wide_sharp_images() -> None:
    for scope in (
        replace(SCOPE, wavefront=((7, 0.05),)), replace(SCOPE, fill_factor=0.5),
        replace(SCOPE, halo=(15.0, 0.1)),
    ):  # fmt: skip
        assert both(gear(), 140.0, scope)[0] is None
    layer = Layer(name="a", outline=gear(), z_um=0.0, reflectance=1.0)
    wide = Window(row=0, column=0, rows=480, columns=640)
    assert read_layer(
        layer, SCOPE, focus_um=12.0, model="exact", window=wide,
        shift_um=(0.0, 0.0), sampling=USUAL,
    ) is None  # fmt: skip


def test_planes_do_not_serve_layers_near_focus() -> None:
    depth_um = SCOPE.wave_depth_um
    assert both(gear(), 1.9 * depth_um)[0] is None
    assert both(gear(), -1.9 * depth_um)[0] is None
    assert both(gear(), 2.1 * depth_um)[0] is not None


def test_a_body_beside_the_window_is_not_seen() -> None:
    read, wanted = both(disc(10.0, (900.0, 0.0)), 20.0)
    assert read is not None
    assert not read.any()
    assert not wanted.any()
