"""Partly coherent images through a wavefront error, against sampled fields and limits.

The judge has polynomials of its own and squares of a field on points, its spectrum by
an FFT; all that it shares is where a disc in focus is, which the image is counted from.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import CubicSpline

from microplan.arrays import ComplexArray, FloatArray, Point
from microplan.optics.coherence.coherence import lit_disc_shift_um, render_coherent
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope, Terms
from tests.optics.shapes import microscope, one_layer, polygon, rectangle

CELL_UM, CELLS = 0.1, 432  # of the judge: the period is that of 30 wavelength / A
ORDERS, POINTS = 60, 144  # to 1 + .8 pupils; squares of what passes do not fold
BOX = (-3.0, -2.0, 2.5, 3.1)  # x0, y0, x1, y1 um: edges of cells
SPIRAL = 160  # points of the judge's source
SAMPLES = 7
JUDGED = 0.005  # of the step: points of both sources, the period, cells that are means


def scope(*terms: tuple[int, float]) -> Microscope:
    """Return a lens with pixels that are points, 0.2 um apart."""
    fine = microscope(37.5, 61, 51)
    return replace(fine, fill_factor=1e-6, wavefront=terms)


def box(z_um: float = 0.0, reflectance: float = 1.0, background: float = 0.0) -> Scene:
    layer = Layer(
        name="box", outline=rectangle(*BOX), z_um=z_um, reflectance=reflectance
    )
    return Scene(layers=(layer,), background=background)


def _polynomial(noll: int, p: FloatArray, q: FloatArray) -> FloatArray:
    """Return a Zernike polynomial in Cartesian form, rms 1 (Malacara, table 13.2)."""
    r2 = p**2 + q**2
    found: FloatArray = {
        5: lambda: math.sqrt(6) * 2 * p * q,
        6: lambda: math.sqrt(6) * (p**2 - q**2),
        7: lambda: math.sqrt(8) * (3 * r2 - 2) * q,
        8: lambda: math.sqrt(8) * (3 * r2 - 2) * p,
        10: lambda: math.sqrt(8) * (p**3 - 3 * p * q**2),
        11: lambda: math.sqrt(5) * (6 * r2**2 - 6 * r2 + 1),
    }[noll]()
    return found


def _spiral(radius: float) -> Iterator[tuple[float, float]]:
    for k in range(SPIRAL):
        r, angle = radius * math.sqrt((k + 0.5) / SPIRAL), k * math.pi * (3 - 5**0.5)
        yield r * math.cos(angle), r * math.sin(angle)


def _field() -> tuple[FloatArray, ComplexArray]:
    """Return frequencies (F,), cycles/um, and the box's spectrum on points, (F, F)."""
    x = (np.arange(CELLS) - CELLS // 2 + 0.5) * CELL_UM
    x0, y0, x1, y1 = BOX
    inside = ((y0 < x) & (x < y1))[:, None] & (x0 < x) & (x < x1)
    f = np.arange(-ORDERS, ORDERS + 1) / (CELLS * CELL_UM)
    whole = np.fft.fft2(np.fft.ifftshift(inside).astype(float), norm="forward")
    at = np.arange(-ORDERS, ORDERS + 1)
    # middles of cells lie half a cell beside the points, and cells are means
    cell = np.exp(-1j * np.pi * f * CELL_UM) * np.sinc(f * CELL_UM)
    return f, whole[np.ix_(at, at)] * cell[:, None] * cell


def judged(
    lens: Microscope, z_um: float, coherence: float, shift_um: Point
) -> FloatArray:
    """Return the light of a white box at a lens' pixels, counted from a shift.

    The reflected field, carried from z to the plane in focus, through exp(2 pi i W).
    """
    f, field = _field()
    radius, k = lens.aperture / lens.wavelength_um, 1 / lens.wavelength_um
    light, direct = np.zeros((POINTS, POINTS)), 0
    block = np.zeros((POINTS, POINTS), np.complex128)
    at = np.arange(-ORDERS, ORDERS + 1)
    for sx, sy in _spiral(coherence):
        p, q = np.meshgrid(f / radius + sx, f / radius + sy)
        waves = -z_um * np.sqrt(np.maximum(k**2 - radius**2 * (p**2 + q**2), 0))
        for noll, rms in lens.wavefront:
            waves += rms * _polynomial(noll, p, q)
        pupil = (p**2 + q**2 <= 1) * np.exp(2j * np.pi * waves)
        block[np.ix_(at, at)] = field * pupil
        light += np.abs(np.fft.ifft2(block, norm="forward")) ** 2
        direct += sx**2 + sy**2 <= 1
    orders = np.fft.fft2(light / direct, norm="forward")
    g = np.fft.fftfreq(POINTS, CELLS * CELL_UM / POINTS)
    step = lens.um_per_px
    x = (np.arange(lens.width_px) - (lens.width_px - 1) / 2) * step + shift_um[0]
    y = ((lens.height_px - 1) / 2 - np.arange(lens.height_px)) * step + shift_um[1]
    up, along = (np.exp(2j * np.pi * np.outer(at_um, g)) for at_um in (y, x))
    return np.asarray((up @ orders @ along.T).real)


@pytest.mark.parametrize(
    ("terms", "z_um", "coherence"),
    [
        (((8, 0.08),), 0.0, 0.6),
        (((7, -0.08),), 2.0, 0.3),
        (((6, 0.08),), 2.5, 0.6),
        (((6, 0.08),), -2.5, 0.6),
        (((11, 0.08),), -2.5, 0.3),
        (((11, 0.08),), 0.0, 0.6),
        (((5, 0.05), (8, 0.06), (10, -0.05), (11, 0.03)), 1.5, 0.8),
    ],
)
def test_a_box_is_as_sampled_fields_show_it(
    terms: Terms, z_um: float, coherence: float
) -> None:
    lens = scope(*terms)
    found, plain = (
        render_coherent(
            box(z_um), each, focus_um=0.0, coherence=coherence, samples=SAMPLES
        )
        for each in (lens, scope())
    )
    shift_um = lit_disc_shift_um(lens, coherence)
    wanted = judged(lens, z_um, coherence, shift_um)
    assert np.abs(found - wanted).max() < JUDGED
    assert np.abs(found - plain).max() > 20 * JUDGED


@pytest.mark.parametrize(
    ("terms", "z_um"), [(((8, 0.08),), 0.0), (((6, 0.06), (11, 0.06)), -2.0)]
)
def test_wide_condensers_come_near_the_incoherent_image(
    terms: Terms, z_um: float
) -> None:
    lens, wide = scope(*terms), 3.0
    found = render_coherent(box(z_um), lens, focus_um=0.0, coherence=wide, samples=3)
    wanted, plain = (render(box(z_um), each, focus_um=0.0) for each in (lens, scope()))
    # corners differ by .11 / coherence through a lens without errors
    assert np.abs(found - wanted).max() < 0.11 / wide
    assert np.abs(wanted - plain).max() > 0.1


def _image(scene: Scene, lens: Microscope, coherence: float = 0.6) -> FloatArray:
    return render_coherent(scene, lens, focus_um=0.0, coherence=coherence, samples=5)


def _negative(terms: Terms) -> Terms:
    return tuple((noll, -waves) for noll, waves in terms)


KITE = polygon([(-4.0, -1.0), (0.5, -3.0), (3.0, 0.5), (0.0, 4.0)])


def test_even_errors_of_the_other_sign_on_the_other_side_are_the_same_image() -> None:
    terms = ((5, 0.04), (6, -0.05), (11, 0.04))
    one = _image(one_layer(KITE, 2.0), scope(*terms))
    other = _image(one_layer(KITE, -2.0), scope(*_negative(terms)))
    same_side = _image(one_layer(KITE, -2.0), scope(*terms))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    assert np.abs(one - same_side).max() > 0.05


def test_any_error_of_the_other_sign_on_the_other_side_mirrors_the_image() -> None:
    """Of a body half a turn about the axis, by half a turn."""
    terms = ((5, 0.04), (7, 0.05), (9, -0.04), (11, 0.04))
    turned = polygon([(4.0, 1.0), (-0.5, 3.0), (-3.0, -0.5), (0.0, -4.0)])
    one = _image(one_layer(KITE, 2.0), scope(*terms))
    other = _image(one_layer(turned, -2.0), scope(*_negative(terms)))
    np.testing.assert_allclose(one, other[::-1, ::-1], rtol=0, atol=1e-6)


def test_the_side_of_a_line_focus_shows_in_coherent_light() -> None:
    """Edges across x and those across y change places with the sign of defocus."""
    square = rectangle(-3.0, -3.0, 3.0, 3.0)
    lens = replace(scope((6, 0.08)), width_px=51)
    above, below = (_image(one_layer(square, z), lens) for z in (2.0, -2.0))
    np.testing.assert_allclose(above, below.T[::-1, ::-1], rtol=0, atol=2e-3)
    assert np.abs(above - below).max() > 0.1


def _middle_um(lens: Microscope, coherence: float, z_um: float = 0.0) -> float:
    """Return the middle of two straight edges, 12 um apart across x, half way up."""
    wide = one_layer(rectangle(-6.0, -40.0, 6.0, 40.0), z_um)
    line = render_coherent(
        wide, lens, focus_um=0.0, coherence=coherence, samples=6,
        window=Window(row=25, column=0, rows=1, columns=lens.width_px),
    )[0]  # fmt: skip
    x = (np.arange(lens.width_px) - (lens.width_px - 1) / 2) * lens.um_per_px
    roots = CubicSpline(x, line - 0.5).roots(extrapolate=False)
    return float(roots[[0, -1]].mean())


def test_coma_moves_edges_by_its_sign_as_its_light_shows_discs() -> None:
    one, other = (replace(scope((8, waves)), width_px=101) for waves in (0.05, -0.05))
    airy_um = one.wavelength_um / one.aperture
    # edges of full contrast about where faint ones are
    for coherence, most in ((0.6, 0.002), (0.1, 0.02)):
        assert abs(_middle_um(one, coherence)) < most * airy_um
    apart_um = lit_disc_shift_um(one, 0.6)[0] - lit_disc_shift_um(one, 1.0)[0]
    assert apart_um > 0.1 * airy_um
    moved_um = _middle_um(one, 0.6, 2.0)
    assert moved_um > 0.02 * airy_um
    assert _middle_um(other, 0.6, 2.0) == pytest.approx(-moved_um, abs=1e-4)


def test_a_halo_is_added_to_the_light() -> None:
    radius_um, share = 1.0, 0.1
    lens = replace(scope((8, 0.06)), width_px=141, height_px=131)
    plain = _image(box(1.0, 0.6, 0.1), lens)
    found = _image(box(1.0, 0.6, 0.1), replace(lens, halo=(radius_um, share)))
    veil = ndimage.gaussian_filter(plain, radius_um / lens.um_per_px, truncate=6)
    wanted = (1 - share) * plain + share * veil
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-4)
    assert np.abs(found - plain).max() > 0.01


@pytest.mark.parametrize("z_um", [0.0, 2.0])
def test_light_past_a_higher_body_meets_the_error_once(z_um: float) -> None:
    """A plug in a hole of a plate, and one that lies on the whole plate."""
    plate, plug = rectangle(-9.0, -8.0, 9.0, 8.0), rectangle(-3.0, -3.0, 3.0, 3.0)
    hole = tuple(ring.reversed() for ring in plug.rings)
    images = []
    for under, above_um in ((Outline(rings=plate.rings + hole), 0.0), (plate, 1e-9)):
        lower = Layer(name="plate", outline=under, z_um=z_um, reflectance=0.8)
        upper = Layer(name="plug", outline=plug, z_um=z_um + above_um, reflectance=0.2)
        images.append(
            _image(Scene(layers=(lower, upper), background=0.05), scope((8, 0.08)))
        )
    # what the mask cuts of the plate's waves, as without an error (test_coherence)
    assert np.abs(images[0] - images[1]).max() < 0.01
