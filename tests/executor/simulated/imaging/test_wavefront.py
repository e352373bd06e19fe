"""Pictures through a wavefront error, against sums over the pupil and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.diffraction import (
    between,
    blurred,
    point_spread,
)
from microplan.executor.simulated.imaging.imaging_view import (
    ImagingView,
    PixelWindow,
    RaySampling,
)
from microplan.executor.simulated.imaging.photograph import photograph
from microplan.executor.simulated.imaging.wavefront import (
    disc_um,
    lens_waves,
    ray_shifts,
    zernike,
)
from tests.executor.simulated.imaging.bodies import (
    APERTURE,
    WAVELENGTH_UM,
    body,
    box,
    circle,
    scene,
    view,
)

STEP_UM, SIDE = 0.2, 512
UNIT_UM = WAVELENGTH_UM / APERTURE
Terms = tuple[tuple[int, float], ...]


def aberrated(magnification: float, focus_um: float, terms: Terms) -> ImagingView:
    """Return the example's microscope with a wavefront error."""
    return replace(view(magnification, focus_um), wavefront=terms)


def pupil_points(count: int) -> tuple[FloatArray, FloatArray]:
    """Return points evenly over the unit disc: even rings, even turns."""
    rho = np.sqrt((np.arange(count) + 0.5) / count)[:, None]
    angle = 2 * math.pi * (np.arange(2 * count) + 0.5) / (2 * count)
    x, y = rho * np.cos(angle), rho * np.sin(angle)
    return x.ravel(), y.ravel()


PUPIL = pupil_points(150)


def by_hand(noll: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return terms as books print them (Noll 1976, table I)."""
    r2, r, t = x**2 + y**2, np.hypot(x, y), np.arctan2(y, x)
    printed = {
        5: math.sqrt(6) * r2 * np.sin(2 * t),
        6: math.sqrt(6) * r2 * np.cos(2 * t),
        7: math.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(t),
        8: math.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(t),
        9: math.sqrt(8) * r**3 * np.sin(3 * t),
        10: math.sqrt(8) * r**3 * np.cos(3 * t),
        11: math.sqrt(5) * (6 * r2**2 - 6 * r2 + 1),
        12: math.sqrt(10) * (4 * r2**2 - 3 * r2) * np.cos(2 * t),
        22: math.sqrt(7) * (20 * r2**3 - 30 * r2**2 + 12 * r2 - 1),
    }
    return np.asarray(printed[noll])


@pytest.mark.parametrize("noll", [5, 6, 7, 8, 9, 10, 11, 12, 22])
def test_terms_are_those_of_the_table(noll: int) -> None:
    np.testing.assert_allclose(zernike(noll, *PUPIL), by_hand(noll, *PUPIL), atol=1e-12)


def test_terms_have_an_rms_of_one_and_nothing_of_each_other() -> None:
    found = np.array([zernike(noll, *PUPIL) for noll in range(1, 23)])
    products = found @ found.T / PUPIL[0].size
    # midpoints of 150 rings: (n / 150)**2 / 2 at n = 6
    np.testing.assert_allclose(products, np.eye(22), atol=2e-3)


def summed(terms: Terms, x_um: FloatArray, y_um: FloatArray, z_um: float) -> FloatArray:
    """Return the light of a point by a sum of plane waves over the pupil, peak 1.

    A body's field in focus is its own carried back by z: each plane wave of frequency
    f has the phase -2 pi z (sqrt(1 / lambda**2 - f**2) - 1 / lambda).
    """
    p, q = PUPIL
    along = np.sqrt(1 - APERTURE**2 * (p**2 + q**2)) - 1
    waves = -z_um / WAVELENGTH_UM * along
    for noll, rms in terms:
        waves = waves + rms * by_hand(noll, p, q)
    field: npt.NDArray[np.complex128] = np.array(
        [
            np.exp(2j * math.pi * (waves + (p * x + q * y) / UNIT_UM)).mean()
            for x, y in zip(x_um, y_um, strict=True)
        ]
    )
    return np.asarray(np.abs(field) ** 2)


@pytest.mark.parametrize("z_um", [0.0, 4.0, -4.0])
@pytest.mark.parametrize(
    "terms",
    [((8, 0.1),), ((7, -0.08),), ((6, 0.1),), ((5, 0.08), (9, -0.05)), ((11, 0.1),)],
)
def test_a_point_is_what_plane_waves_add_up_to(terms: Terms, z_um: float) -> None:
    lens = aberrated(44.5, 0.0, terms)
    spread = point_spread((SIDE, SIDE), STEP_UM, lens, z_um)
    flat = point_spread((SIDE, SIDE), STEP_UM, view(44.5, 0.0), 0.0)[0, 0]
    rng = np.random.default_rng(5)
    i, j = rng.integers(-18, 19, (2, 60))
    aside = disc_um(lens)  # where discs are shown is not moved
    wanted = summed(terms, STEP_UM * i + aside[0], STEP_UM * j + aside[1], z_um)
    # the tile repeats the wave as it does an Airy disc's: 2e-3 of the perfect peak
    np.testing.assert_allclose(spread[j, i] / flat, wanted, atol=2e-3)


@pytest.mark.parametrize(("noll", "axis"), [(8, 1), (7, 0)])
def test_the_tail_of_positive_coma_lies_towards_less(noll: int, axis: int) -> None:
    """Noll 8 along x, 7 along y; rows go up."""
    spread = point_spread(
        (SIDE, SIDE), STEP_UM, aberrated(44.5, 0.0, ((noll, 0.1),)), 0
    )
    line = spread.sum(axis=1 - axis)
    assert line[-20:-7].sum() > 2 * line[8:21].sum()  # beyond the first dark ring


@pytest.mark.parametrize(
    "terms",
    [
        pytest.param(((8, 0.05),), marks=pytest.mark.slow),
        ((6, 0.07),),
        ((11, 0.07), (10, 0.03)),
    ],
)
def test_an_edge_is_as_soft_as_the_pupils_overlap_says(terms: Terms) -> None:
    """By overlaps of two pupils at each frequency, without images of points."""
    lens = replace(aberrated(44.5, 0.0, terms), fill_factor=1e-9)
    x = STEP_UM * (np.arange(SIDE) - SIDE / 2)
    plane = np.tile(np.clip(0.5 + x / STEP_UM, 0, 1), (64, 1))
    seen = blurred(plane, STEP_UM, lens, 0.0)[0]
    p, q = pupil_points(80)

    def waves(at: FloatArray) -> FloatArray:
        return sum((rms * by_hand(noll, at, q) for noll, rms in terms), np.zeros(1))

    shifts = (np.arange(120) + 0.5) / 120 * 2
    overlap = [
        np.mean(
            (np.hypot(p + s, q) < 1) * np.exp(2j * math.pi * (waves(p + s) - waves(p)))
        )
        for s in shifts
    ]
    near = np.abs(x) < 3
    at = (x[near] + disc_um(lens)[0])[:, None]
    sines = (np.array(overlap) * np.exp(2j * math.pi * shifts / UNIT_UM * at)).imag
    exact = 0.5 + (sines / shifts).mean(axis=1) * 2 / math.pi
    # as of a perfect lens, .003; 80 rings of the pupil, .002 where two overlap
    np.testing.assert_allclose(seen[near], exact, atol=0.005)


def test_a_large_disc_in_focus_is_shown_where_it_is() -> None:
    """By a circle through the half level of its edge, as a calibration finds it."""
    lens = aberrated(20.0, 30.0, ((8, 0.06), (7, -0.03)))
    disc = scene(body([circle(0, 0, 25)], 29.0, 30.0, 0.9), stage=0.0)
    window = PixelWindow(row=160, column=240, rows=160, columns=160)
    found = [
        edge_middle(photograph(disc, each, window)) / lens.px_per_um
        for each in (lens, replace(lens, wavefront=()))
    ]
    # by terms alone .051 and .025 um; borders far away send .001 of the step, which is
    # .5 per um: 2 nm
    np.testing.assert_allclose(found[0] - found[1], 0.0, atol=2e-3)


def edge_middle(light: FloatArray) -> FloatArray:
    """Return the middle (x, y) px of a circle through half of .9 of light, (2,)."""
    angle = 2 * math.pi / 24 * np.arange(24)
    c, s, middle = np.cos(angle), np.sin(angle), (light.shape[0] - 1) / 2
    low, high = np.full(24, 55.0), np.full(24, 78.0)  # px from the middle
    for _ in range(30):
        radius = (low + high) / 2
        over = between(light, middle + radius * c, middle - radius * s) > 0.45
        low, high = np.where(over, radius, low), np.where(over, high, radius)
    return np.array([2 * np.mean(low * c), 2 * np.mean(low * s)])


@pytest.mark.parametrize(
    ("terms", "drop_um"),
    [
        (((8, 0.1),), 20.0),
        (((7, -0.1),), 70.0),
        pytest.param(((8, 0.1),), 70.0, marks=pytest.mark.slow),
        pytest.param(((7, -0.1),), 20.0, marks=pytest.mark.slow),
    ],
)
def test_what_is_far_out_of_focus_moves_as_the_mean_of_rays(
    terms: Terms, drop_um: float
) -> None:
    """By waves at 20 um, by rays alone at 70: lambda / A sqrt 8 of coma's waves."""
    lens = aberrated(6.9, 100.0 + drop_um, terms)
    disc = body([circle(0, 0, 15)], 99.0, 100.0, 0.9)
    window = PixelWindow(row=170, column=250, rows=140, columns=140)
    stage = replace(scene(disc, stage=0.0), stage_um=-300.0)
    light = [
        photograph(stage, each, window) for each in (lens, view(6.9, lens.focus_um))
    ]
    y, x = np.mgrid[0:140, 0:140]
    middle = [np.array([(m * x).sum(), -(m * y).sum()]) / m.sum() for m in light]
    moved = (middle[0] - middle[1]) / lens.px_per_um
    ((noll, waves),) = terms
    axis = 0 if noll == 8 else 1
    wanted = np.zeros(2)
    wanted[axis] = -UNIT_UM * math.sqrt(8) * waves
    wanted -= disc_um(lens)
    # a wave's light falls with the square of the way: some of it leaves the window
    np.testing.assert_allclose(moved, wanted, atol=0.05 * UNIT_UM * math.sqrt(8) * 0.1)


def test_a_ray_passes_by_as_the_wavefront_slopes() -> None:
    lens = aberrated(20.0, 0.0, ((6, 0.1),))
    found = ray_shifts(lens, np.array([[0.2, 0.0], [-0.2, 0.0], [0.0, 0.2]]))
    assert found is not None
    sine = 0.2 / math.sqrt(1.04) / APERTURE
    # W = .1 sqrt 6 (x**2 - y**2); light goes the other way than the ray down
    slope = UNIT_UM * 0.1 * math.sqrt(6) * 2 * sine
    np.testing.assert_allclose(found, [[-slope, 0], [slope, 0], [0, slope]], atol=1e-6)
    assert ray_shifts(view(20.0, 0.0), np.zeros((1, 2))) is None


@pytest.mark.parametrize("focus_um", [1.0, -3.0, 6.0])
def test_a_face_that_half_the_pupil_sees_is_shown_aside(focus_um: float) -> None:
    """A black body high above hides one half: what moves is the other half's mean."""
    made = (
        body([circle(0, 0, 4)], 0.0, 1.0, 0.9),
        body([box(0, -300, 300, 300)], 100.0, 101.0, 0.0),
    )
    window = PixelWindow(row=200, column=280, rows=80, columns=80)
    lens = aberrated(20.0, focus_um, ((6, 0.1),))
    fine = RaySampling(plane_spacing_um=1.0)  # light by direction, on a disc of 4 um
    light = [
        photograph(scene(*made, stage=0.0), each, window, sampling=fine)
        for each in (lens, replace(lens, wavefront=()))
    ]
    x = (np.arange(80) - 39.5) / lens.px_per_um
    middle = [(each.sum(axis=0) * x).sum() / each.sum() for each in light]
    # of half a disc the mean of |x| is 4 / (3 pi); W = .1 sqrt 6 (x**2 - y**2)
    wanted = UNIT_UM * 0.1 * math.sqrt(6) * 2 * 4 / (3 * math.pi)
    # the disc's sides see 54 and 46 % of the pupil: second order, .01
    assert middle[0] - middle[1] == pytest.approx(wanted, rel=0.05)


def test_terms_of_nothing_change_next_to_nothing() -> None:
    face = body([box(-9, -6, 8, 5)], 0.0, 30.0, 0.8)
    window = PixelWindow(row=220, column=300, rows=30, columns=30)
    for focus_um in (30.0, 33.0):
        plain = photograph(scene(face), view(20.0, focus_um), window)
        none = photograph(scene(face), aberrated(20.0, focus_um, ((8, 0.0),)), window)
        # a wave in single precision
        np.testing.assert_allclose(none, plain, atol=1e-5)


def test_a_lens_tilts_by_where_it_shows_discs() -> None:
    lens = aberrated(44.5, 0.0, ((8, 0.05),))
    x, y = np.array([0.5, -0.5]), np.array([0.2, 0.2])
    bare = 0.05 * by_hand(8, x, y)
    np.testing.assert_allclose(
        lens_waves(lens, x, y) - bare, x * disc_um(lens)[0] / UNIT_UM, atol=1e-12
    )


@pytest.mark.parametrize("term", [(4, 0.1), (23, 0.1), (8, math.nan)])
def test_what_is_no_aberration_is_refused(term: tuple[int, float]) -> None:
    with pytest.raises(ValueError, match="no aberration"):
        aberrated(20.0, 0.0, (term,))
