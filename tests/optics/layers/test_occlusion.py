"""Occlusion against its limits, random rays, a wave calculation and the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import fft

from microplan.arrays import FloatArray
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.rays import slopes
from microplan.optics.oracle import Oracle, oracle_image
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import hopkins
from tests.optics.shapes import disc, microscope, rectangle
from tests.optics.wave import behind_a_mask, places

BAND_AND_MARGIN = 1.4e-3  # what `render` may err by


def pair(
    back: Outline,
    front: Outline,
    back_um: float,
    front_um: float,
    tones: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Scene:
    """Return a back behind a front over a background, with the tones of the three."""
    layers = (
        Layer(name="back", outline=back, z_um=back_um, reflectance=tones[0]),
        Layer(name="front", outline=front, z_um=front_um, reflectance=tones[1]),
    )
    return Scene(layers=layers, background=tones[2])


def halves(gap_um: float, back_um: float, front_um: float) -> Scene:
    """Return two plates that leave a gap between them, seen from above."""
    back = rectangle(-300, -300, -gap_um / 2, 300)
    return pair(back, rectangle(gap_um / 2, -300, 300, 300), back_um, front_um)


def test_rays_fill_the_pupil_evenly_by_its_area() -> None:
    optics = microscope()
    tangents = np.hypot(*slopes(optics, 4096).T)
    sines = tangents / np.hypot(1, tangents)
    assert sines.max() < optics.aperture
    for share in (0.1, 0.5, 0.9):
        inside = np.mean(sines < optics.aperture * np.sqrt(share))
        assert abs(inside - share) < 1 / 4096


@pytest.mark.parametrize(("back_um", "front_um"), [(-12.0, 9.0), (0.0, 20.0)])
def test_a_uniform_layer_leaves_the_other_as_it_is(
    back_um: float, front_um: float
) -> None:
    optics, wide = microscope(6.9, 40, 30), rectangle(-2e3, -2e3, 2e3, 2e3)
    for back, front in ((wide, disc(9.0)), (disc(9.0), wide)):
        scene = pair(back, front, back_um, front_um, (1.0, 0.3, 0.1))
        found = occluded(scene, optics, focus_um=0.0)
        blended = render(scene, optics, focus_um=0.0)
        np.testing.assert_allclose(found, blended, rtol=0, atol=1e-12)


def test_in_focus_the_hidden_part_is_cut_off_before_the_blur() -> None:
    optics = microscope(20.0, 60, 8)
    scene = pair(rectangle(-40, -40, 0, 40), rectangle(0, -40, 40, 40), -1e-6, 0.0)
    # what is seen is the back alone
    seen = Oracle.of(rectangle(-40, -40, 0, 40), optics).image("exact", 0.0)
    found = occluded(scene, optics, focus_um=0.0)
    assert np.abs(render(scene, optics, focus_um=0.0) - seen).max() > 0.15
    # a cell that two edges share holds up to 1 / 4 of the product that should be 0,
    # over its width: 1 / 6 on average, times the steepest rise of an edge
    step_um = 0.12 * optics.wavelength_um / optics.aperture
    steepest_per_um = 8 / (3 * np.pi) * optics.cutoff_per_um
    assert np.abs(found - seen).max() < step_um / 6 * steepest_per_um


def test_random_rays_agree_where_nothing_diffracts() -> None:
    optics = replace(microscope(6.9, 26, 20), wavelength_um=0.02)
    scene = pair(
        disc(6.0, (2.0, 1.0)),
        rectangle(-20, -15, 1.0, 3.0),
        -15.0,
        10.0,
        (1.0, 0.0, 0.2),
    )
    found = occluded(scene, optics, focus_um=0.0, samples=1024, step_um=0.15)
    rng, count = np.random.default_rng(7), 20_000
    errors = []
    for row, column in rng.integers(0, 20, (60, 2)):
        x, y = _in_pixel(optics, int(row), int(column), rng.random((2, count)))
        sine, turn = optics.aperture * np.sqrt(rng.random(count)), rng.random(count)
        dx, dy = (
            sine
            / np.sqrt(1 - sine**2)
            * np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])
        )
        seen = np.where(np.hypot(x - 15 * dx - 2, y - 15 * dy - 1) < 6, 1.0, 0.2)
        over = (np.abs(x + 10 * dx + 9.5) < 10.5) & (np.abs(y + 10 * dy + 6) < 9)
        errors.append(found[row, column] - np.where(over, 0.0, seen).mean())
    # 60 means of 20000 rays stray by 5 standard deviations .4 / sqrt(20000); at .02 um
    # edges are 1 - T wide, .03 of a pixel
    assert np.abs(errors).max() < 5 * 0.4 / np.sqrt(count) + 0.01
    blended = render(scene, optics, focus_um=0.0)
    assert np.abs(blended - found).max() > 0.05


def _in_pixel(
    optics: Microscope, row: int, column: int, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points of a pixel; `at` (2, N) in 0..1."""
    p = optics.um_per_px
    x = (column - (optics.width_px - 1) / 2 + at[0] - 0.5) * p
    return x, ((optics.height_px - 1) / 2 - row + at[1] - 0.5) * p


# Largest error of blending and of tracing against waves, as measured on these pairs
# and rounded up (`benchmarks.optics.layers` has many more); depths in n wavelength /
# A**2 and gaps in wavelength / A. In focus and touching, blending errs by 1 / 4.
WAVES = (
    ((0.0, -1e-6, 0.0), 0.25, 0.01),
    ((0.0, -0.294, 0.0), 0.16, 0.04),
    ((0.0, -0.735, 0.0), 0.10, 0.05),
    ((0.0, -1.47, 0.0), 0.05, 0.04),
    ((0.0, -2.94, 0.0), 0.03, 0.03),
    ((2.94, -2.94, 0.0), 0.21, 0.07),
    ((8.82, 2.94, 0.0), 0.23, 0.04),
)


@pytest.mark.parametrize(("case", "blend", "traced"), WAVES)
def test_waves_judge_blending_and_tracing(
    case: tuple[float, float, float], blend: float, traced: float
) -> None:
    front_z, back_z, gap = case
    optics = replace(microscope(1.0, 1, 1), aperture=0.15)  # paraxial: tan = sin
    unit = optics.wavelength_um / optics.aperture
    depth = optics.wavelength_um / optics.aperture**2
    x = places(1280, 0.0875)
    back = ((x < -gap / 2) & (x > -30)).astype(np.float64)
    mask = (x < gap / 2).astype(np.float64)
    truth = behind_a_mask(x, back, mask, front_z, back_z)
    near = np.abs(x) < 12
    optics = replace(
        optics,
        magnification=optics.pitch_um / (0.0875 * unit),
        width_px=int(near.sum()),
        fill_factor=1e-6,
    )
    scene = halves(gap * unit, back_z * depth, front_z * depth)
    call = {"focus_um": 0.0, "model": "hopkins", "samples": 512}
    ours = occluded(scene, optics, **call)[0]  # type: ignore[arg-type]
    plain = render(scene, optics, focus_um=0.0, model="hopkins")[0]
    assert np.abs(plain - truth[near]).max() < blend
    assert np.abs(ours - truth[near]).max() < traced


def test_waves_without_a_mask_show_the_blurred_back() -> None:
    x = places(1280, 0.0875)
    back = (np.abs(x) < 9).astype(np.float64)
    f = np.abs(fft.fftfreq(x.size, 0.0875)) / 2
    for front_z, back_z in ((0.0, 0.0), (1.0, 0.0), (2.0, -3.0)):
        found = behind_a_mask(x, back, np.ones_like(x), front_z, back_z)
        law = hopkins(np.minimum(f, 1.0), back_z / 2)
        blurred = fft.ifft(fft.fft(back) * law).real
        # 6 Gauss nodes over the pupil's height, whose ends are cut on a grid
        np.testing.assert_allclose(found, blurred, rtol=0, atol=3e-3)


@pytest.mark.parametrize("focus_um", [0.0, 8.0])
def test_three_layers_meet_the_oracle(focus_um: float) -> None:
    optics = microscope(6.9, 16, 12)
    low = pair(disc(5.0), rectangle(-30, -30, 0, 2), 0.0, 14.0, (0.8, 0.0, 0.1))
    top = Layer(name="top", outline=disc(4.0, (3.0, 4.0)), z_um=22.0, reflectance=0.5)
    scene = replace(low, layers=(*low.layers, top))
    found = occluded(scene, optics, focus_um=focus_um)
    exact = oracle_image(scene, optics, focus_um=focus_um, samples=600, step_um=0.16)
    blended = render(scene, optics, focus_um=focus_um)
    assert np.abs(found - exact).max() < 5e-3
    assert np.abs(found - exact).max() < np.abs(blended - exact).max()


def test_window_and_light_are_those_of_render() -> None:
    optics = microscope(6.9, 36, 30)
    scene = pair(disc(9.0), rectangle(-30, -30, 0, 2), -9.0, 9.0, (1.0, 0.4, 0.1))
    light = Illumination(gain=0.9, gradient_x=0.3)
    whole = occluded(scene, optics, focus_um=0.0, light=light)
    piece = Window(row=4, column=5, rows=20, columns=22)
    part = occluded(scene, optics, focus_um=0.0, light=light, window=piece)
    # another crop has other cells beyond its rim
    np.testing.assert_allclose(part, whole[4:24, 5:27], rtol=0, atol=2e-3)


def test_a_scene_without_layers_is_its_background() -> None:
    empty = Scene(layers=(), background=0.25)
    assert np.all(occluded(empty, microscope(6.9, 5, 4), focus_um=3.0) == 0.25)
    with pytest.raises(ValueError, match="at least 1, got 0"):
        slopes(microscope(), 0)
