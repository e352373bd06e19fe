from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.integrate import quad
from scipy.interpolate import BSpline, CubicSpline

from microplan.arrays import FloatArray
from microplan.featuresel.routines.likelihood.spline import (
    basis,
    cubic_weights,
    depth_coefficients,
    plane_coefficients,
    runout_coefficients,
)

T = np.linspace(0, 1, 41)
EPS = np.finfo(float).eps
# What the table of the square's transform errs by, linear between 512 radii up to
# .72 cycles a sample times a side of 3 samples: step**2 / 8 times the curvature, at
# most that at 0, pi**2 / 3.
TABLE = (0.72 * 3 / 511) ** 2 / 8 * math.pi**2 / 3


def test_a_parabola_is_run_out_exactly() -> None:
    place = np.arange(6.0)
    found = runout_coefficients((2 - 3 * place + 0.5 * place**2)[:, None])[:, 0]
    for at in (0.0, 0.3, 2.5, 5.0):
        near = basis(at + 1, len(found))
        value = near.weights @ found[near.first : near.first + 4]
        slope = near.slopes @ found[near.first : near.first + 4]
        assert value == pytest.approx(2 - 3 * at + 0.5 * at**2, abs=1e-12)
        assert slope == pytest.approx(-3 + at, abs=1e-12)


def test_weights_are_those_of_scipys_spline() -> None:
    weights, _ = cubic_weights(T)
    bump = BSpline.basis_element(np.arange(-2.0, 3.0), extrapolate=False)
    for k in range(4):
        away = np.clip(T - (k - 1), -2, 2)
        np.testing.assert_allclose(weights[k], bump(away), atol=4 * EPS)


def test_weights_are_a_partition_of_one() -> None:
    weights, slopes = cubic_weights(T)
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=4 * EPS)
    np.testing.assert_allclose(slopes.sum(axis=0), 0, atol=4 * EPS)
    assert (weights >= 0).all()


def test_slopes_are_the_weights_derivatives() -> None:
    step = 1e-4
    inner = T[1:-1]
    high, low = (cubic_weights(inner + h)[0] for h in (step, -step))
    # third derivatives of the four cubics are at most 3, and rounding
    tolerance = step**2 / 6 * 3 + 4 * EPS / step
    np.testing.assert_allclose(
        (high - low) / (2 * step), cubic_weights(inner)[1], atol=tolerance
    )


@pytest.mark.parametrize("place", [1.0, 1.7, 4.25, 6.999, 7.0])
def test_cubics_are_reproduced(place: float) -> None:
    # Marsden's identity: coefficients k**3 - k make x**3, k**2 - 1/3 make x**2
    k = np.arange(9.0)
    at = basis(place, len(k))
    near = slice(at.first, at.first + 4)
    for power, coefficients in ((1, k), (2, k**2 - 1 / 3), (3, k**3 - k)):
        value, slope = at.weights @ coefficients[near], at.slopes @ coefficients[near]
        assert value == pytest.approx(place**power, rel=1e-13)
        assert slope == pytest.approx(power * place ** (power - 1), rel=1e-13)


@pytest.mark.parametrize(("place", "clamped"), [(-3.0, 1.0), (0.4, 1.0), (99.0, 7.0)])
def test_places_beyond_the_range_are_its_ends(place: float, clamped: float) -> None:
    far, end = basis(place, 9), basis(clamped, 9)
    assert far.first == end.first
    np.testing.assert_array_equal(far.weights, end.weights)


def test_single_precision_stays_single() -> None:
    weights, slopes = cubic_weights(T.astype(np.float32))
    assert weights.dtype == slopes.dtype == np.float32


def test_depths_are_a_natural_spline() -> None:
    values = np.random.default_rng(3).random((8, 5))
    coefficients = depth_coefficients(values)
    other = CubicSpline(np.arange(8.0), values, bc_type="natural")
    for place in np.linspace(1, 6, 26):
        at = basis(place, 8)
        found = at.weights @ coefficients[at.first : at.first + 4]
        np.testing.assert_allclose(found, other(place), atol=1e-13)


def at_nodes(coefficients: FloatArray) -> FloatArray:
    """Return a spline's values at its inner nodes."""
    kernel = np.array([1, 4, 1]) / 6
    near = sliding_window_view(coefficients, (3, 3))
    return np.asarray(np.einsum("rcij,i,j->rc", near, kernel, kernel))


def square(fx: float, fy: float, phi: float) -> float:
    """Return the transform of a unit square turned clockwise by phi."""
    c, s = math.cos(phi), math.sin(phi)
    return float(np.sinc(fx * c - fy * s) * np.sinc(fx * s + fy * c))


def harmonic(f: float, order: int) -> float:
    """Return a harmonic of that over the direction of the frequency."""

    def integrand(angle: float) -> float:
        turned = square(f * math.cos(angle), f * math.sin(angle), 0.0)
        return turned * math.cos(order * angle)

    return float(quad(integrand, 0, math.pi / 2)[0]) * 4 / math.pi


# a wave whose mirror image goes on where it ends, in half periods of 60 x 48 samples
WAVES = [(6, 0), (0, 9), (13, 7), (20, 31), (38, 0), (36, 25)]
SHAPE = (48, 60)
OVER, SIDE = 3, 0.9


def wave(m: int, n: int) -> tuple[FloatArray, float, float]:
    """Return a product of cosines, and its frequencies in cycles a pixel's side."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    fx, fy = m / (2 * SHAPE[1]), n / (2 * SHAPE[0])
    across = np.cos(2 * math.pi * fx * (columns + 0.5))
    down = np.cos(2 * math.pi * fy * (rows + 0.5))
    return across * down, fx * OVER * SIDE, fy * OVER * SIDE


@pytest.mark.parametrize(("m", "n"), WAVES)
def test_pixels_along_the_axes_collect_a_wave_times_sinc(m: int, n: int) -> None:
    template, fx, fy = wave(m, n)
    (plane,) = plane_coefficients(template, over=OVER, side=SIDE, turns=False)
    expected = template * np.sinc(fx) * np.sinc(fy)
    np.testing.assert_allclose(at_nodes(plane), expected[1:-1, 1:-1], atol=1e-12)


@pytest.mark.parametrize("phi", [0.0, 0.2, math.pi / 8, 0.6, 2.0, -1.1])
@pytest.mark.parametrize(("m", "n"), WAVES)
def test_turned_pixels_collect_a_wave_but_for_the_eighth_harmonic(
    m: int, n: int, phi: float
) -> None:
    template, fx, fy = wave(m, n)
    planes = plane_coefficients(template, over=OVER, side=SIDE, turns=True)
    turns = (1.0, math.cos(4 * phi), math.sin(4 * phi))
    found = at_nodes(np.tensordot(turns, planes, axes=1))
    # the product of cosines is half waves of both directions; y goes up, rows down
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = (columns + 0.5) / (OVER * SIDE), -(rows + 0.5) / (OVER * SIDE)
    expected = np.zeros(SHAPE)
    for sign in (1, -1):
        phase = 2 * math.pi * (fx * x + sign * fy * y)
        expected += square(fx, sign * fy, phi) * np.cos(phase) / 2
    size = math.hypot(fx, fy)
    left = sum(abs(harmonic(size, order)) for order in (8, 12)) + 2 * TABLE
    assert np.abs(found - expected[1:-1, 1:-1]).max() < left
    assert left < 0.01  # of the wave: and finer ones have less contrast


def test_an_even_template_stays_even_to_its_borders() -> None:
    planes = plane_coefficients(np.full((9, 11), 0.4), over=1, side=0.7, turns=True)
    np.testing.assert_allclose(planes[0], 0.4, atol=1e-12)
    np.testing.assert_allclose(planes[1:], 0.0, atol=1e-12)
