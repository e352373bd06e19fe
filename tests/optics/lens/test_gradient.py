"""Shifts by uneven light: predictions against rendered images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import gaussian_filter1d

from microplan.arrays import FloatArray
from microplan.optics.lens.gradient import (
    centroid_shift_um,
    moments,
    relative_gradient,
    slope_per_um,
    steepest_shift_um,
    threshold_shift_um,
)
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.sampling import BAND_ERROR
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction, hopkins
from tests.optics.shapes import circle, disc, gear, microscope, polygon, rectangle

# Pixels of 37.5 nm: the band ends at a twentieth of a pixel's sampling rate, so that
# splines of degree 7 through the samples are exact for what is asked here.
FINE = microscope(200.0, width_px=800, height_px=8)


def _row(
    levels: tuple[float, float], defocus_um: float, gradient: float, outline: Outline
) -> tuple[FloatArray, FloatArray]:
    """Return places, um, and the image along a row through the axis."""
    dark, bright = levels
    layer = Layer(name="part", outline=outline, z_um=defocus_um, reflectance=bright)
    image = render(
        Scene(layers=(layer,), background=dark),
        FINE,
        focus_um=0.0,
        light=Illumination(gradient_x=gradient),
        window=Window(row=4, column=0, rows=1, columns=800),
    )[0]
    x = np.linspace(-399.5, 399.5, 800) * FINE.um_per_px
    return x, image


def _root(spline: BSpline, near_um: float, reach_um: float) -> float:
    """Return the root of a spline nearest to a place, by bisection."""
    low, high = near_um - reach_um, near_um + reach_um
    rising = spline(high) > spline(low)
    for _ in range(60):
        middle = (low + high) / 2
        if (spline(middle) > 0) == rising:
            high = middle
        else:
            low = middle
    return (low + high) / 2


def _second_moment() -> float:
    """Return the integral of x**2 times the transfer in focus over 0..1."""
    x = np.linspace(0, 1, 2001)
    return float(np.trapezoid(x**2 * diffraction(x), x))


@pytest.mark.parametrize("levels", [(0.0, 1.0), (0.3, 0.8)])
@pytest.mark.parametrize("rising", [True, False])
@pytest.mark.parametrize(
    ("defocus_um", "smoothing_um"), [(0.0, 0.0), (0.0, 0.3), (2.0, 0.5), (5.0, 1.2)]
)
def test_the_steepest_point_moves_up_the_gradient(
    levels: tuple[float, float], rising: bool, defocus_um: float, smoothing_um: float
) -> None:
    ends = (0.0, 300.0) if rising else (-300.0, 0.0)
    body, gradient = rectangle(ends[0], -200.0, ends[1], 200.0), 0.5
    places = []
    for lit in (0.0, gradient):
        x, image = _row(levels, defocus_um, lit, body)
        if smoothing_um:
            image = gaussian_filter1d(
                image, smoothing_um / FINE.um_per_px, truncate=8.0, mode="nearest"
            )
        bend = make_interp_spline(x, image, k=7).derivative(2)
        places.append(_root(bend, 0.0, 0.15))
    g = gradient / FINE.field_um[0]
    shift = steepest_shift_um(g, FINE, defocus_um, smoothing_um=smoothing_um)
    spread = math.sqrt(abs(shift) / g) + smoothing_um
    # the next order of g is g**2 times the variance; 4 as in (2 v)**2 / v
    rest = 4 * (g * spread) ** 2
    # Cutting the band leaves out BAND_ERROR pi / 3 of the integral of the transfer over
    # x, all of it near x = 1, and so that of its integral with x**2.
    cut = 0.0 if smoothing_um else BAND_ERROR * math.pi / 3 / _second_moment()
    # The body's other edges are 200 um off or cut at the margin: 8e-4 of contrast over
    # 60 um is a slope of 1e-5, next to the .0167 of the light.
    assert places[1] - places[0] == pytest.approx(shift, rel=rest + cut + 1e-3)
    assert abs(shift) > 1e-3


@pytest.mark.parametrize("levels", [(0.0, 1.0), (0.3, 0.8)])
@pytest.mark.parametrize("defocus_um", [0.0, 3.0])
def test_a_threshold_moves_opposite_edges_alike(
    levels: tuple[float, float], defocus_um: float
) -> None:
    radius, gradient = 9.0, 0.05
    half = sum(levels) / 2
    crossings = []
    for lit in (0.0, gradient):
        x, image = _row(levels, defocus_um, lit, disc(radius))
        level = make_interp_spline(x, image - half, k=7)
        crossings.append([_root(level, side * radius, 0.5) for side in (-1, 1)])
    shifts = np.diff(crossings, axis=0)[0]
    g = gradient / FINE.field_um[0]
    slope = slope_per_um(FINE, defocus_um)
    shift = threshold_shift_um(g, slope, levels, lever_um=radius)
    # both ways to first order; the mean of the two is right to second order. A curved
    # edge is not as steep: by its curvature's half times the blur, squared at once.
    bent = FINE.blur_diameter_um(defocus_um) / 2 + FINE.airy_radius_um
    rel = (g * radius) ** 2 + (bent / radius) ** 2
    assert shifts.mean() == pytest.approx(shift, rel=rel + 0.002)
    assert (shifts > 0).all()


@pytest.mark.parametrize("z", [0.0, 1.0, 8.0])
def test_the_slope_is_that_of_a_rendered_edge(z: float) -> None:
    x, image = _row((0.0, 1.0), z, 0.0, rectangle(0.0, -200.0, 300.0, 200.0))
    found = float(make_interp_spline(x, image, k=7).derivative(1)(0.0))
    # BAND_ERROR over the shortest wave of the band, 2 pi 1.4 per um, at most
    assert found == pytest.approx(slope_per_um(FINE, z), abs=5e-4 * 8.8)


def test_the_slope_in_focus_is_its_closed_form() -> None:
    # the integral of the transfer over x is 4 / (3 pi); no pixel
    optics = replace(microscope(), fill_factor=1e-12)
    exact = 16 * optics.aperture / (3 * math.pi * optics.wavelength_um)
    assert slope_per_um(optics, 0.0) == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("z", [0.0, 2.0, 10.0, 100.0])
def test_the_integrals_over_the_band_have_converged(z: float) -> None:
    optics = microscope()
    waves = optics.rim_w20_um(z) / optics.wavelength_um

    def term(f: float) -> float:
        x = np.array([f / optics.cutoff_per_um])
        law = diffraction(x) if z == 0 else hopkins(x, waves)
        return float(law[0] * np.sinc(f * optics.um_per_px))

    points = np.linspace(0, optics.cutoff_per_um, 80)[1:-1]
    exact, error = quad(
        term, 0, optics.cutoff_per_um, points=points, limit=400, epsabs=1e-9
    )
    assert slope_per_um(optics, z) == pytest.approx(2 * exact, abs=1e-7 + 2 * error)


def test_smoothing_far_beyond_the_blur_leaves_its_gaussian() -> None:
    s = 20.0
    shift = steepest_shift_um(1e-3, FINE, 0.0, smoothing_um=s)
    # With the transfer's start 1 - c f, c = 4 / (pi cutoff): moments of a Gaussian in f
    # give v = s**2 (1 + c / (pi s sqrt(2 pi))), and c**2 is the next order.
    c = 4 / (math.pi * FINE.cutoff_per_um) / s
    first = 2 * (1 + c / (math.pi * math.sqrt(2 * math.pi))) - 1
    assert shift == pytest.approx(1e-3 * s**2 * first, rel=c**2)


@pytest.mark.parametrize("z", [0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
def test_edges_smoothed_like_an_edge_finder_are_steepest_in_the_middle(
    z: float,
) -> None:
    optics = microscope()
    smoothing = max(0.8 * optics.um_per_px, optics.blur_diameter_um(z) / 4)
    shift = steepest_shift_um(1e-4, optics, z, smoothing_um=smoothing)
    blur2 = (optics.blur_diameter_um(z) / 4) ** 2  # the disc's variance along x
    # v lies between s**2 and, for two Gaussians, s**2 + b**2 and the Airy and pixel's
    assert 0.9e-4 * smoothing**2 < shift
    assert shift < 1e-4 * (smoothing**2 + 4 * blur2 + 4 * optics.um_per_px**2)


@pytest.mark.parametrize("body", [disc(40.0, (5.0, -3.0)), gear()])
def test_the_centroid_of_light_moves_by_the_second_moment(body: Outline) -> None:
    optics, gradient = microscope(), (0.3, -0.2)
    layer = Layer(name="part", outline=body, z_um=0.0, reflectance=1.0)
    scene = Scene(layers=(layer,), background=0.0)
    found = []
    for gx, gy in ((0.0, 0.0), gradient):
        light = Illumination(gradient_x=gx, gradient_y=gy)
        image = render(scene, optics, focus_um=0.0, light=light)
        share = image / image.sum()
        rows, columns = np.indices(image.shape)
        found.append(
            [
                (share * (columns - 79.5)).sum() * optics.um_per_px,
                (share * (59.5 - rows)).sum() * optics.um_per_px,
            ]
        )
    shift = np.array(centroid_shift_um(body, gradient, optics))
    moved = np.diff(found, axis=0)[0]
    # The line spread ends as (wavelength / A) / (pi**3 x**2), so a frame of width W
    # adds up to W wavelength / (pi**3 A) to the second moment; its core, and the
    # pixel, less than (wavelength / A)**2.
    area, _, second = moments(body)
    airy = optics.wavelength_um / optics.aperture
    tail = np.array(optics.field_um) * airy / math.pi**3
    excess = (moved / shift - 1) * np.diag(second) / area
    assert (excess > 0).all()
    assert (excess < tail + airy**2).all()
    assert 1000 * np.hypot(*shift) > 500


def test_moments_of_known_bodies() -> None:
    area, center, second = moments(rectangle(1.0, -2.0, 5.0, 10.0))
    assert area == pytest.approx(48.0, rel=1e-13)
    assert center == pytest.approx((3.0, 4.0), rel=1e-13)
    np.testing.assert_allclose(
        second, [[12 * 64 / 12, 0], [0, 4 * 1728 / 12]], atol=1e-10
    )
    triangle = polygon([(0.0, 0.0), (6.0, 0.0), (0.0, 3.0)])
    area, center, second = moments(triangle)
    assert (area, *center) == pytest.approx((9.0, 2.0, 1.0), rel=1e-13)
    # b**3 h / 36, h**3 b / 36, -b**2 h**2 / 72
    np.testing.assert_allclose(second, [[18.0, -4.5], [-4.5, 4.5]], rtol=1e-12)
    ring = Outline(rings=(circle(5.0, (1e3, 0.0)), circle(3.0, (1e3, 0.0), hole=True)))
    area, center, second = moments(ring)
    assert area == pytest.approx(16 * math.pi, rel=1e-8)
    assert center == pytest.approx((1e3, 0.0), abs=1e-6)
    inertia = math.pi / 4 * (5**4 - 3**4)
    np.testing.assert_allclose(second, inertia * np.eye(2), atol=1e-7 * inertia)


@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(-80, 80))
def test_the_relative_gradient_is_the_slope_of_the_log_of_the_light(
    gx: float, gy: float, x: float
) -> None:
    optics, h = microscope(), 1e-3
    width, height = optics.field_um
    found = relative_gradient(optics, (gx, gy), (x, 10.0))

    def log(dx: float, dy: float) -> float:
        return math.log(1 + gx * (x + dx) / width + gy * (10.0 + dy) / height)

    quotient = [(log(h, 0) - log(-h, 0)) / 2 / h, (log(0, h) - log(0, -h)) / 2 / h]
    assert found == pytest.approx(quotient, abs=1e-7)


def test_what_has_no_shift_is_refused() -> None:
    optics: Microscope = microscope()
    with pytest.raises(ValueError, match="it must be positive"):
        relative_gradient(optics, (2.0, 0.0), (-100.0, 0.0))
    with pytest.raises(ValueError, match="two levels"):
        threshold_shift_um(0.1, 1.0, (0.5, 0.5), lever_um=1.0)
    with pytest.raises(ValueError, match="a slope"):
        threshold_shift_um(0.1, math.nan, (0.0, 0.5), lever_um=1.0)
    with pytest.raises(ValueError, match="smoothing_um must be finite"):
        steepest_shift_um(0.1, optics, 0.0, smoothing_um=math.nan)
    with pytest.raises(ValueError, match="no area"):
        moments(Outline(rings=(circle(1.0, hole=True),)))
