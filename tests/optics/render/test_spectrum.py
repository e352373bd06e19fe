"""Spectra against closed forms and a second quadrature; clipping against areas."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j1

from microplan.arrays import ComplexArray, FloatArray
from microplan.optics.outline.clip import EdgeArrays, clip, to_edges
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment, flatten, place
from microplan.optics.render.nufft_gridding import KERNEL_ERROR
from microplan.optics.render.spectrum import (
    RULES,
    Spectrum,
    Tile,
    boundary_nodes,
    spectrum,
)
from tests.optics.shapes import circle, disc, gear, polygon, rectangle

TILE = Tile(left_um=-80, bottom_um=-85, width_um=170, height_um=165)
FREQUENCY = st.floats(-1.5, 1.5)


def direct(
    outline: Outline, u_per_um: FloatArray, v_per_um: FloatArray
) -> ComplexArray:
    """Return the Fourier integral of an outline node by node, slowly.

    Parameters
    ----------
    outline : Outline
        Closed rings, um.
    u_per_um, v_per_um : (...) float arrays
        Frequencies along x and y, cycles/um.

    Returns
    -------
    (...) complex array
        Integral of exp(-2 pi i (u x + v y)) over the outline, um2.
    """
    u, v = np.broadcast_arrays(u_per_um, v_per_um)
    top = float(max(np.hypot(u, v).max(), 1e-3))
    edges = clip(outline, outline.bounds_um)
    x, y, dx, dy = boundary_nodes(edges, top)
    reach = max(float(np.abs(x).max()), float(np.abs(y).max()))
    result = np.empty(u.shape, dtype=np.complex128)
    for index in np.ndindex(u.shape):
        p, q = u[index], v[index]
        if math.hypot(p, q) * reach < 1e-9:  # the phase is nowhere felt
            result[index] = edges.area_um2
            continue
        wave = np.exp(-2j * np.pi * (p * x + q * y))
        # divergence theorem with the field along whichever axis divides safely
        along_x = abs(p) >= abs(q)
        sums = wave @ dy if along_x else -(wave @ dx)
        result[index] = sums * 1j / (2 * np.pi * (p if along_x else q))
    return result


def _polygon_integral(outline: Outline, u: float, v: float) -> complex:
    """Sum a sinc for every straight edge, as in Chu & Huang."""
    r2, total = u * u + v * v, 0j
    for ring in outline.rings:
        for edge in ring.edges:
            assert isinstance(edge, Segment)
            dx, dy = edge.end[0] - edge.start[0], edge.end[1] - edge.start[1]
            cx, cy = edge.start[0] + dx / 2, edge.start[1] + dy / 2
            wave = np.exp(-2j * np.pi * (u * cx + v * cy))
            total += (u * dy - v * dx) * np.sinc(u * dx + v * dy) * wave
    return complex(1j * total / (2 * np.pi * r2))


@given(FREQUENCY, FREQUENCY)
def test_direct_is_a_product_of_sincs_for_a_rectangle(u: float, v: float) -> None:
    found = direct(rectangle(-3, 1, 5, 4), np.array(u), np.array(v))
    wave = np.exp(-2j * np.pi * (u * 1.0 + v * 2.5))
    # dividing by a small frequency magnifies rounding: 1e-16 x perimeter / f, and below
    # 1e-9 / 5 um the area stands for the integral
    atol = 1e-6 + 1e-14 / max(abs(u), abs(v), 1e-10)
    np.testing.assert_allclose(
        found, 24 * np.sinc(8 * u) * np.sinc(3 * v) * wave, rtol=0, atol=atol
    )


@given(FREQUENCY, FREQUENCY)
def test_direct_is_a_bessel_function_for_a_disc(u: float, v: float) -> None:
    f = math.hypot(u, v)
    q = 2 * math.pi * f * 7
    expected = math.pi * 49 * (2 * j1(q) / q if q > 1e-6 else 1.0)
    found = direct(disc(7.0), np.array(u), np.array(v))
    atol = 2e-6 + 1e-14 / max(abs(u), abs(v), 1e-10)
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


def test_direct_meets_the_sum_of_edges_for_a_polygon() -> None:
    shape = polygon([(0, 0), (9, 1), (11, 7), (4, 3), (-2, 8)])
    for u, v in ((0.3, 0.1), (-0.7, 1.1), (0.0, 0.4), (1.3, 0.0)):
        expected = _polygon_integral(shape, u, v)
        found = direct(shape, np.array(u), np.array(v))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def _direct_share(
    outline: Outline, tile: Tile, j: FloatArray, k: FloatArray
) -> ComplexArray:
    """Return exact coefficients of a tile from the Fourier integral."""
    u, v = j / tile.width_um, k / tile.height_um
    wave = np.exp(2j * np.pi * (u * tile.left_um + v * tile.bottom_um))
    share: ComplexArray = (
        direct(outline, u, v) * wave / (tile.width_um * tile.height_um)
    )
    return share


def _compare(found: Spectrum, outline: Outline) -> float:
    """Return the worst difference over low orders and random ones."""
    J, K = found.orders
    rng = np.random.default_rng(3)
    j = np.concatenate([np.repeat([0, 1, 2], 20), rng.integers(0, J + 1, 150)])
    k = np.concatenate([np.tile(np.arange(-10, 10), 3), rng.integers(-K, K + 1, 150)])
    inside = np.hypot(j / J, k / K) <= 1
    j, k = j[inside], k[inside]
    exact = _direct_share(outline, found.tile, j.astype(float), k.astype(float))
    return float(np.abs(found.values[k, j] - exact).max())


def _spreading_error(outline: Outline) -> float:
    return KERNEL_ERROR * outline.perimeter_um / 165 / (2 * np.pi)


def test_spreading_meets_direct_sums_for_the_gear() -> None:
    outline = place(gear(), 3.2, -1.7, 0.3)
    found = spectrum(outline, TILE, 1.3)
    assert _compare(found, outline) < _spreading_error(outline)
    assert found.values[0, 0] == pytest.approx(outline.area_um2 / (170 * 165), 1e-12)


def test_spreading_meets_direct_sums_for_a_tiny_disc() -> None:
    outline = disc(0.05, (1.0, 2.0))
    assert _compare(spectrum(outline, TILE, 1.3), outline) < _spreading_error(outline)


@pytest.mark.parametrize(("size", "limit"), RULES)
def test_rules_integrate_waves_up_to_their_limits(size: int, limit: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(size)
    phase = np.linspace(0.0, limit, 1000)[1:]
    found = weights @ np.cos(np.outer(nodes, phase)) / 2
    assert np.abs(found - np.sin(phase) / phase).max() <= 1e-8


def test_a_cut_keeps_the_low_orders() -> None:
    outline = gear()
    wide, narrow = spectrum(outline, TILE, 1.3), spectrum(outline, TILE, 0.2)
    part = wide.cut(0.2)
    assert part.orders == narrow.orders == (34, 33)
    near = np.hypot(np.arange(35) / 34, np.r_[0:34, -33:0][:, None] / 33) <= 1
    np.testing.assert_allclose(
        part.values[near],
        narrow.values[near],
        rtol=0,
        atol=2 * _spreading_error(outline),
    )
    assert wide.cut(2.0) is wide


def test_a_plate_larger_than_the_tile_is_a_constant() -> None:
    found = spectrum(rectangle(-1e4, -1e4, 1e4, 1e4), TILE, 1.0)
    assert found.values[0, 0] == 1
    assert np.abs(found.values).sum() == 1


def test_what_lies_outside_the_tile_is_nothing() -> None:
    found = spectrum(disc(10.0, (500.0, 0.0)), TILE, 1.0)
    assert not found.values.any()


def test_a_half_plane_has_no_variation_along_its_edge() -> None:
    found = spectrum(rectangle(-1e4, -1e4, 1e4, 20.0), TILE, 1.0)
    assert found.values[0, 0] == pytest.approx(105 / 165, rel=1e-12)
    assert np.abs(found.values[:, 1:]).max() < 1e-8


@pytest.mark.parametrize("cut", [-1.0, math.nan, math.inf])
def test_a_band_that_cannot_be_is_refused(cut: float) -> None:
    with pytest.raises(ValueError, match="cut_per_um"):
        spectrum(gear(), TILE, cut)


def test_clipping_keeps_arcs_that_lie_inside() -> None:
    part = clip(gear(), (-60, -60, 60, 60))
    assert len(part.arcs) == 37
    assert part.area_um2 == pytest.approx(gear().area_um2, rel=1e-12)
    one_side = clip(gear(), (-60, -60, 0, 60))
    assert 10 < len(one_side.arcs) < 37


@given(st.floats(-80, 80), st.floats(-80, 80), st.floats(0, 6.3), st.floats(-40, 40))
@settings(deadline=None)
def test_halves_of_a_box_add_up(x: float, y: float, turn: float, cut: float) -> None:
    outline = place(gear(), x, y, turn)
    left = clip(outline, (-50, -45, cut, 45)).area_um2
    right = clip(outline, (cut, -45, 50, 45)).area_um2
    whole = clip(outline, (-50, -45, 50, 45)).area_um2
    assert left + right == pytest.approx(whole, abs=1e-9)
    assert -1e-9 <= left <= (cut + 50) * 90 + 1e-9


def test_a_huge_finger_is_cut_to_the_box() -> None:
    part = clip(rectangle(-30, 5, 30, 20_000), (-100, -100, 100, 100))
    assert part.area_um2 == pytest.approx(60 * 95, rel=1e-12)
    assert np.abs(part.segments).max() <= 100


def test_an_arc_beyond_a_side_leaves_one_segment_on_it() -> None:
    arc = np.array([[10.0, 0.0, 3.0, 0.3, 5.0]])  # x from 7 to 13
    bow = EdgeArrays(segments=np.empty((0, 4)), arcs=arc)
    part = clip(bow, (-5.0, -2.0, 5.0, 2.0))
    assert len(part.arcs) == 0
    ends = [5.0, 3 * math.sin(0.3), 5.0, -2.0]  # 3 sin 5.3 = -2.5, below the box
    np.testing.assert_allclose(part.segments, [ends], rtol=1e-15)
    corner = clip(bow, (-5.0, -9.0, 5.0, -4.0))  # all of it moves onto a corner
    assert len(corner.segments) + len(corner.arcs) == 0


def test_quarters_of_a_gear_add_up() -> None:
    boxes = [(-60, -60, 10, -20), (10, -60, 60, -20), (-60, -20, 60, 60)]
    parts = [clip(gear(), box).area_um2 for box in boxes]
    assert sum(parts) == pytest.approx(gear().area_um2, rel=1e-12)


def test_area_of_edges_agrees_with_the_outline_and_its_polygon() -> None:
    ring = Ring(edges=gear().rings[0].edges)
    corners = flatten(ring, 1e-6)
    x, y = corners.T
    shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    area = to_edges(Outline(rings=(ring, circle(25.0, hole=True)))).area_um2
    assert area == pytest.approx(gear().area_um2, rel=1e-13)
    assert area == pytest.approx(shoelace - math.pi * 625, rel=1e-6)


@pytest.mark.parametrize("sweep", [1.0, -1.0])
@pytest.mark.parametrize("start", [0.0, math.pi / 2, 2.0, -7.0])
@pytest.mark.parametrize("cut_um", [-9.0, 0.0, 6.0])
def test_what_is_left_of_a_circle_is_arcs(
    sweep: float, start: float, cut_um: float
) -> None:
    """A circle without its cap, whose area is known in closed form."""
    circle = Arc(
        center=(3.0, -4.0),
        radius_um=10.0,
        start_rad=start,
        sweep_rad=sweep * 2 * math.pi,
    )
    body = Outline(rings=(Ring(edges=(circle,)),))
    part = clip(body, (3.0 + cut_um, -20.0, 20.0, 20.0))
    kept = 10.0**2 * math.acos(cut_um / 10) - cut_um * math.sqrt(100 - cut_um**2)
    assert part.area_um2 == pytest.approx(sweep * kept, rel=1e-13)
    swept = np.abs(part.arcs[:, 4]).sum()
    assert swept == pytest.approx(2 * math.acos(cut_um / 10), rel=1e-13)
    assert (part.arcs[:, 4] != 0).all()  # it may start on a side's line
    assert len(part.segments) in (1, 2)  # the start may lie on the side of the cap


def test_an_arc_around_a_corner_of_the_box_closes() -> None:
    part = clip(disc(10.0), (-20.0, -20.0, 6.0, 8.0))  # corner on the circle
    inside = clip(disc(10.0), (-20.0, -20.0, 5.0, 7.0))  # corner inside it
    within = clip(disc(100.0), (-1.0, -1.0, 1.0, 1.0))
    assert within.area_um2 == pytest.approx(4.0, rel=1e-13)
    assert len(within.arcs) == 0
    for found, right, top in ((part, 6.0, 8.0), (inside, 5.0, 7.0)):
        x = np.linspace(-10, right, 2_000_001)
        half = np.sqrt(np.maximum(100 - x**2, 0.0))
        expected = np.trapezoid(np.minimum(half, top) + half, x)
        # of the root at the far end the rule errs by h**1.5
        assert found.area_um2 == pytest.approx(expected, abs=1e-6)


@given(
    st.floats(-100, 100), st.floats(0.1, 100), st.floats(-7, 7), st.floats(-0.9, 0.9)
)
@settings(deadline=None)
def test_a_box_that_touches_a_circle_keeps_it(
    y: float, radius: float, start: float, cut: float
) -> None:
    """The middle of an arc may be where it touches, give or take a rounding."""
    arc = Arc(center=(0.7, y), radius_um=radius, start_rad=start, sweep_rad=2 * math.pi)
    body = Outline(rings=(Ring(edges=(arc,)),))
    x0, _, x1, y1 = body.bounds_um
    below = y + cut * radius
    kept = clip(body, (x0, below, x1, y1)).area_um2
    cap = math.acos(cut) - cut * math.sqrt(1 - cut * cut)
    assert kept == pytest.approx(cap * radius**2, rel=1e-8)
