"""Images in partially coherent light against edges in one dimension, and limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1, sici

from microplan.arrays import FloatArray
from microplan.optics.coherence.coherence import FULL_COHERENCE, render_coherent
from microplan.optics.coherence.source import disc_source, source_error
from microplan.optics.outline.outline import Outline
from microplan.optics.render.nufft_gridding import KERNEL_ERROR
from microplan.optics.render.render import render
from microplan.optics.render.sampling import MARGIN
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction
from tests.optics.coherence.coherent_edge import Phase, abbe_edge, no_phase
from tests.optics.shapes import circle, disc, microscope, one_layer, rectangle

# An endless edge, coherent: (1/2 + Si(2 pi x) / pi)**2 is 1 - cos(2 pi x) / (pi**2 x)
# far away, and the tile ends `MARGIN` wavelengths over A from the pixels.
TILE = 1 / (math.pi**2 * MARGIN)
LINE = Window(row=30, column=0, rows=1, columns=120)


def _fine() -> Microscope:
    """Return a setting whose pixels are points."""
    return replace(microscope(60.0, 120, 61), fill_factor=1e-6)


def _places(optics: Microscope) -> FloatArray:
    """Return the columns' distances from the axis, wavelength / A."""
    columns = np.arange(optics.width_px, dtype=np.float64)
    x: FloatArray = (columns - (optics.width_px - 1) / 2) * optics.um_per_px
    places: FloatArray = x * optics.aperture / optics.wavelength_um
    return places


def _exact_phase(optics: Microscope, z_um: float) -> Phase:
    A, n = optics.aperture, optics.medium_index
    k = 2 * math.pi / optics.wavelength_um
    return lambda rho2: k * z_um * np.sqrt(n**2 - A**2 * rho2)


def _coherent_step(x: FloatArray) -> FloatArray:
    intensity: FloatArray = (0.5 + sici(2 * np.pi * x)[0] / np.pi) ** 2
    return intensity


def test_the_edge_calculation_meets_the_coherent_closed_form() -> None:
    x = np.linspace(-4, 4, 161)
    found = abbe_edge(x, 1e-6).full
    # over the source's radius of 1e-6 the amplitude changes by less than 2 pi x 1e-6
    np.testing.assert_allclose(found, _coherent_step(x), rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("coherence", "samples"), [(1e-300, 16), (0.3, 16), (1.0, 10), (1.5, 6)]
)
def test_a_long_edge_meets_one_dimension(coherence: float, samples: int) -> None:
    optics = _fine()
    scene = one_layer(rectangle(0.0, -400.0, 400.0, 400.0))
    found = render_coherent(
        scene, optics, focus_um=0.0, coherence=coherence, window=LINE, samples=samples
    )
    x = _places(optics)
    expected = abbe_edge(x, coherence).full if coherence > 0.1 else _coherent_step(x)
    atol = source_error(samples) + 2 * TILE  # the edge comes again on both sides
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=atol)


@pytest.mark.parametrize("z_um", [-2.0, 4.0])
def test_a_defocused_edge_meets_one_dimension(z_um: float) -> None:
    optics = _fine()
    scene = one_layer(rectangle(0.0, -400.0, 400.0, 400.0), z_um)
    found = render_coherent(
        scene, optics, focus_um=0.0, coherence=0.4, window=LINE, samples=12
    )
    phase = _exact_phase(optics, z_um)
    expected = abbe_edge(_places(optics), 0.4, phase, nodes=18).full
    atol = source_error(12) + 2 * TILE
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=atol)


def _transmission(f: FloatArray, coherence: float) -> FloatArray:
    """Return Hopkins' cross-coefficients of frequencies on a line, (N, N)."""
    nodes, weights = np.polynomial.legendre.leggauss(100)
    angle = (1 + nodes) * np.pi / 4
    sy = min(coherence, 1.0) * np.sin(angle)
    weight = weights * np.cos(angle)
    total, norm = np.zeros((f.size, f.size)), 0.0
    for y, w in zip(sy, weight, strict=True):
        half, reach = math.sqrt(1 - y**2), math.sqrt(coherence**2 - y**2)
        high = np.minimum(reach, half - np.maximum(f, f[:, None]))
        low = np.maximum(-reach, -half - np.minimum(f, f[:, None]))
        total += w * np.maximum(high - low, 0)
        norm += w * 2 * min(half, reach)
    return total / norm


@pytest.mark.parametrize("coherence", [0.2, 0.6, 1.2])
def test_a_bar_meets_hopkins_integral(coherence: float) -> None:
    optics, width = _fine(), 1.7  # wavelength / A
    step = 0.02  # a bar repeated after 50 wavelength / A: coherent tails are below TILE
    f = np.arange(-math.ceil((1 + coherence) / step), 1 + (1 + coherence) // step)
    f = f * step
    waves = np.exp(2j * np.pi * f[:, None] * _places(optics))
    waves = waves * (width * np.sinc(width * f) * step)[:, None]
    cross = _transmission(f, coherence)
    expected = np.einsum("ax,ab,bx->x", waves, cross, waves.conj()).real
    half = width / 2 * optics.wavelength_um / optics.aperture
    found = render_coherent(
        one_layer(rectangle(-half, -400.0, half, 400.0)),
        optics,
        focus_um=0.0,
        coherence=coherence,
        window=LINE,
        samples=8,
    )
    atol = source_error(8) + 2 * TILE
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=atol)


def test_energy_is_what_the_pupil_lets_through() -> None:
    optics, radius = microscope(), 5.0
    image = render_coherent(one_layer(disc(radius)), optics, focus_um=0.0, coherence=1)
    f = (np.arange(200_000) + 0.5) * (2 / 200_000)  # radii of the pupil, to 2
    per_um = f * optics.cutoff_per_um / 2
    power = (radius * j1(2 * np.pi * radius * per_um) / per_um) ** 2
    # an order passes for the share of the source that is within the shifted pupil
    passed = power * diffraction(f / 2) * 2 * np.pi * per_um
    expected = passed.sum() * (per_um[1] - per_um[0])
    seen = image.sum() * optics.um_per_px**2
    # what leaves the frame: as in incoherent light, see test_render
    assert seen == pytest.approx(expected, rel=3e-3 * 20 / radius)


def test_zero_coherence_is_the_incoherent_renderer() -> None:
    scene, light = one_layer(disc(8.0, (3.0, 1.0)), 2.0), Illumination(gradient_x=0.3)
    found = render_coherent(
        scene, microscope(), focus_um=0.0, coherence=0, light=light, shift_um=(1, 2)
    )
    expected = render(scene, microscope(), focus_um=0.0, light=light, shift_um=(1, 2))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


def test_wide_condensers_come_near_incoherent_light() -> None:
    optics, scene = microscope(30.0, 60, 50), one_layer(disc(4.0))
    expected = render(scene, optics, focus_um=0.0)

    found = render_coherent(scene, optics, focus_um=0.0, coherence=1000.0, samples=5)
    # a straight edge differs by .086 / coherence (test_edge_offsets)
    full = 0.086 / FULL_COHERENCE + source_error(5)
    difference = np.abs(found - expected).max()
    assert 1e-6 < difference < full * FULL_COHERENCE / 1000


@pytest.mark.parametrize("coherence", [0.4, 1.5])
def test_a_uniform_field_keeps_its_reflectance(coherence: float) -> None:
    optics, window = microscope(), Window(row=50, column=70, rows=9, columns=9)
    part = Layer(name="a", outline=disc(4.0), z_um=3.0, reflectance=0.64)
    wide = replace(part, outline=rectangle(-500.0, -500.0, 500.0, 500.0))
    for scene in (
        Scene(layers=(part,), background=0.64),  # no contrast
        Scene(layers=(wide,), background=0.1),
        Scene(layers=(), background=0.64),
    ):
        found = render_coherent(
            scene, optics, focus_um=0.0, coherence=coherence, window=window, samples=2
        )
        # spreading errs by 1e-5 of what the outline contributes
        np.testing.assert_allclose(found, 0.64, rtol=0, atol=1e-4)


def test_light_scales_the_image() -> None:
    optics, scene = microscope(), one_layer(disc(9.0))
    plain = render_coherent(scene, optics, focus_um=0.0, coherence=0.2)
    light = Illumination(gain=0.5, gradient_y=0.2)
    lit = render_coherent(scene, optics, focus_um=0.0, coherence=0.2, light=light)
    white = render(Scene(layers=(), background=1.0), optics, focus_um=0.0, light=light)
    np.testing.assert_allclose(lit, plain * white, rtol=0, atol=1e-15)


def test_both_sides_of_focus_look_alike() -> None:
    optics, scene = microscope(20.0, 80, 60), one_layer(rectangle(-4.0, -2.0, 5.0, 6.0))
    near, far = (
        render_coherent(scene, optics, focus_um=z, coherence=0.6, samples=6)
        for z in (-4.0, 4.0)
    )
    np.testing.assert_allclose(near, far, rtol=0, atol=1e-9)


def test_a_symmetric_body_has_a_symmetric_image() -> None:
    optics = microscope(20.0, 81, 61)
    for z_um in (0.0, 3.0):  # half the source, and all of it
        image = render_coherent(
            one_layer(rectangle(-6.0, -3.0, 6.0, 3.0), z_um),
            optics, focus_um=0.0, coherence=0.6, samples=6,
        )  # fmt: skip
        np.testing.assert_allclose(image, image[::-1, ::-1], rtol=0, atol=KERNEL_ERROR)


def test_an_image_shifted_by_a_pixel_is_the_same_image() -> None:
    optics, scene = microscope(), one_layer(disc(3.0))
    p = optics.um_per_px
    before = render_coherent(scene, optics, focus_um=0.0, coherence=0.5, samples=6)
    after = render_coherent(
        scene, optics, focus_um=0.0, coherence=0.5, samples=6, shift_um=(p, -2 * p)
    )
    np.testing.assert_allclose(after[2:, 1:], before[:-2, :-1], rtol=0, atol=1e-9)


def test_the_source_converges_as_stated() -> None:
    optics = microscope(20.0, 120, 120)
    field = Outline(
        rings=tuple(
            circle(2.1, (6.1 * i, 5.3 * j)) for i in range(-1, 2) for j in range(-1, 2)
        )
    )

    def image(samples: int) -> FloatArray:
        return render_coherent(
            one_layer(field), optics, focus_um=0.0, coherence=0.4, samples=samples
        )

    finest = image(24)
    for samples in (4, 8, 12):
        assert np.abs(image(samples) - finest).max() < source_error(samples)


@pytest.mark.parametrize("coherence", [1e-300, 0.5, 1.0, 3.0])
def test_source_points_fill_the_disc(coherence: float) -> None:
    source = disc_source(coherence, 8)
    rho2 = (source.x / coherence) ** 2 + (source.y / coherence) ** 2
    assert rho2.max() < 1
    assert source.weight[np.hypot(source.x, source.y) < 1].sum() == pytest.approx(1)
    assert source.weight.sum() == pytest.approx(max(coherence, 1.0) ** 2)
    # Gauss nodes over the squared radius are exact for the mean of its powers
    mean = (source.weight * rho2).sum() / source.weight.sum()
    assert mean == pytest.approx(0.5)
    half = disc_source(coherence, 8, half=True)
    assert half.x.size == source.x.size // 2
    assert half.weight.sum() == pytest.approx(source.weight.sum())


def _stack(upper_um: float, *, cut: bool) -> Scene:
    """Return a dim plug in a bright plate: on it, or in a hole of the plate."""
    plate, plug = rectangle(-12.0, -10.0, 12.0, 10.0), rectangle(-5.0, -4.0, 5.0, 4.0)
    hole = tuple(ring.reversed() for ring in plug.rings)
    under = Outline(rings=plate.rings + hole) if cut else plate
    return Scene(
        layers=(
            Layer(name="plate", outline=under, z_um=0.0, reflectance=0.8),
            Layer(name="plug", outline=plug, z_um=upper_um, reflectance=0.2),
        ),
        background=0.05,
    )


@pytest.mark.parametrize("coherence", [0.2, 0.8])
def test_a_higher_layer_blocks_what_lies_below(coherence: float) -> None:
    optics = microscope(20.0, 100, 90)
    one, two = (
        render_coherent(scene, optics, focus_um=0.0, coherence=coherence, samples=3)
        for scene in (_stack(0.0, cut=True), _stack(1e-9, cut=False))
    )
    # the plate's amplitude 6 um, 4.2 wavelength / A, from its edge is off by up to
    # 1 / (2 pi**2 4.2), and what the mask cuts of that is the difference, squared in
    # the image: twice with the root of .8
    assert np.abs(one - two).max() < 2 * math.sqrt(0.8) / (2 * math.pi**2 * 4.2)


def test_bodies_of_one_height_may_overlap() -> None:
    optics = microscope(20.0, 100, 90)
    a = Layer(name="a", outline=rectangle(-12, -10, 12, 10), z_um=0, reflectance=0.8)
    b = replace(a, name="b", outline=rectangle(-5, -4, 5, 4), reflectance=0.2)
    found = render_coherent(
        Scene(layers=(b, a), background=0.05), optics, focus_um=0.0, coherence=0.8,
        samples=3,
    )  # fmt: skip
    expected = render_coherent(
        _stack(1e-9, cut=False), optics, focus_um=0.0, coherence=0.8, samples=3
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("coherence", math.nan), ("coherence", -0.1), ("coherence", math.inf),
        ("focus_um", math.nan), ("samples", 0), ("shift_um", (0.0, math.nan)),
    ],
)  # fmt: skip
def test_bad_numbers_are_refused(name: str, value: object) -> None:
    given: dict[str, object] = {"focus_um": 0.0, "coherence": 0.5, name: value}
    with pytest.raises(ValueError, match=name):
        render_coherent(one_layer(disc(3.0)), microscope(), **given)  # type: ignore[arg-type]  # on purpose


def test_bad_sources_are_refused() -> None:
    for coherence, samples in ((0.0, 4), (math.nan, 4), (math.inf, 4), (0.5, 0)):
        with pytest.raises(ValueError, match="must be"):
            disc_source(coherence, samples)
    with pytest.raises(ValueError, match="samples"):
        source_error(0)


def test_no_phase_is_flat() -> None:
    assert not no_phase(np.ones(3)).any()
