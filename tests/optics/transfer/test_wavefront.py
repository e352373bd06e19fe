"""The OTF's change by a wavefront error, against integrals and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.real import twin_pictures
from microplan.optics.transfer.microscope import Microscope, Terms
from microplan.optics.transfer.otf import diffraction
from microplan.optics.transfer.wavefront import (
    disc_shift_um,
    most_defocus_um,
    transfer_change,
)
from microplan.optics.transfer.zernike import zernike
from tests.optics.shapes import microscope

CENTROID = math.sqrt(8)  # of a point through coma of 1 wave rms, wavelength over A


def lens(*terms: tuple[int, float], magnification: float = 44.5) -> Microscope:
    return replace(microscope(magnification), wavefront=terms)


def change_along(
    scope: Microscope, z_um: float, f_per_um: np.ndarray, angle: float
) -> np.ndarray:
    """Return the OTF's change along a line through frequency 0."""
    u, v = f_per_um * math.cos(angle), f_per_um * math.sin(angle)
    return np.diagonal(transfer_change(scope, z_um, u, v))


def overlap(scope: Microscope, z_um: float, x: float, angle: float) -> complex:
    """Return the OTF at x cutoffs by Gauss's rule over the common area of two pupils.

    In the frame whose first axis is that of the frequency.
    """
    nodes, weights = np.polynomial.legendre.leggauss(80)
    high = math.sqrt(1 - x**2)
    q = nodes[:, None] * high
    half = np.sqrt(1 - q**2) - x
    p = nodes[None, :] * half
    q = np.broadcast_to(q, p.shape)
    share = weights[:, None] * high * weights[None, :] * half
    c, s = math.cos(angle), math.sin(angle)

    def waves(p: np.ndarray) -> np.ndarray:
        across = scope.medium_index / scope.wavelength_um
        f2 = (p**2 + q**2) * (scope.aperture / scope.wavelength_um) ** 2
        found = z_um * (across - np.sqrt(np.maximum(across**2 - f2, 0)))
        for noll, rms in scope.wavefront:
            found = found + rms * zernike(noll, c * p - s * q, s * p + c * q)
        return np.asarray(found)

    phase = np.exp(2j * np.pi * (waves(p + x) - waves(p - x)))
    return complex((share * phase).sum() / np.pi)


@pytest.mark.parametrize("z_um", [0.0, 2.5, -2.5, 9.0])
@pytest.mark.parametrize(
    "terms", [((8, 0.05),), ((5, 0.06),), ((11, -0.07),), ((7, 0.03), (10, 0.2))]
)
def test_it_is_the_overlap_of_two_pupils(terms: Terms, z_um: float) -> None:
    scope, plain = lens(*terms), lens()
    most, off = 0.0, 0.0
    for x in (0.04, 0.15, 0.35, 0.6, 0.85):
        for angle in (0.0, 0.7, 2.0):
            f = np.array([x * scope.cutoff_per_um])
            found = change_along(scope, z_um, f, angle)[0]
            wanted = overlap(scope, z_um, x, angle) - overlap(plain, z_um, x, angle)
            most, off = max(most, abs(wanted)), max(off, abs(found - wanted))
    assert off < 0.02 * most  # what the module says


@pytest.mark.parametrize("z_um", [0.0, 3.0])
def test_coma_moves_a_points_centroid_by_its_mean_slope(z_um: float) -> None:
    """The slope of the OTF's phase at 0 is the mean of the wavefront's gradient."""
    waves = 0.04
    scope = lens((8, waves))
    u = np.array([0.03, 0.06]) * scope.cutoff_per_um
    change = change_along(scope, z_um, u, 0.0)
    near, far = change.imag / (2 * np.pi * u)
    wanted = CENTROID * waves * scope.wavelength_um / scope.aperture
    assert 2 * near - far == pytest.approx(wanted, rel=0.05)  # at frequency 0


@pytest.mark.parametrize("noll", [5, 6, 7, 8, 9, 10, 11, 12, 14])
@pytest.mark.parametrize("waves", [0.02, 1 / 14])
def test_a_points_peak_falls_as_strehl_s_ratio_says(noll: int, waves: float) -> None:
    """Marechal, as an exponential: exp(-(2 pi w)**2), right to w**4 (Mahajan 1983)."""
    scope = lens((noll, waves))
    f = np.linspace(-1, 1, 161) * scope.cutoff_per_um
    change = transfer_change(scope, 0.0, f, f)
    whole = diffraction(np.hypot(f[None, :], f[:, None]) / scope.cutoff_per_um).sum()
    lost = 1 - math.exp(-((2 * np.pi * waves) ** 2))
    assert change.real.sum() / whole == pytest.approx(-lost, rel=0.06)


@pytest.mark.parametrize("z_um", [0.0, 4.0])
def test_mirrored_coma_is_the_mirrored_image(z_um: float) -> None:
    f = np.linspace(-0.9, 0.9, 13) * lens().cutoff_per_um
    one, other = (
        change_along(lens((8, waves)), z_um, f, 0.3) for waves in (0.06, -0.06)
    )
    np.testing.assert_allclose(one, other.conj(), atol=1e-12)
    np.testing.assert_allclose(one[::-1], one.conj(), atol=1e-12)


def test_nothing_changes_nothing() -> None:
    u = np.linspace(-2, 2, 9)
    for terms in ((), ((8, 0.0), (5, 0.0))):
        scope = lens(*terms)
        assert not transfer_change(scope, 1.0, u, u).any()
        assert disc_shift_um(scope) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_disc_in_focus_moves_with_coma_alone() -> None:
    waves = 0.05
    x, y = disc_shift_um(lens((8, waves)))
    assert abs(y) < 1e-12
    assert disc_shift_um(lens((7, waves))) == pytest.approx((y, x), abs=1e-12)
    assert disc_shift_um(lens((8, -waves))) == pytest.approx((-x, y), abs=1e-12)
    for noll in (5, 6, 9, 10, 11, 14):
        # square pixels mix a fourfold part into a threefold one, and nothing else
        assert math.hypot(*disc_shift_um(lens((noll, waves)))) < 2e-3 * abs(x)
    # by less than the centroid, and the nearer to it the larger the pixels
    scope = lens()
    most = CENTROID * waves * scope.wavelength_um / scope.aperture
    shifts = [
        -disc_shift_um(lens((8, waves), magnification=m))[0] for m in (100, 20, 5, 0.2)
    ]
    assert 0 < shifts[0] < shifts[1] < shifts[2] < shifts[3] < most
    assert shifts[3] > 0.9 * most


def test_finer_samples_show_discs_where_the_cameras_pixels_do() -> None:
    scope = lens((8, 0.05), magnification=5)
    finer = replace(scope, pitch_um=scope.pitch_um / 3, fill_factor=0.5)
    there = replace(finer, disc_side_um=scope.side_um)
    assert abs(disc_shift_um(finer)[0] - disc_shift_um(scope)[0]) > 0.01
    assert disc_shift_um(there) == pytest.approx(disc_shift_um(scope), rel=1e-9)
    with pytest.raises(ValueError, match="disc_side_um must be > 0"):
        replace(scope, disc_side_um=0.0)


def edge_um(scope: Microscope, angle: float) -> float:
    """Return where an edge's profile is half way up, by the overlap's integral."""
    x = (np.arange(200) + 0.5) / 200
    f = x * scope.cutoff_per_um
    side = f * scope.um_per_px
    transfer = np.array([overlap(scope, 0.0, float(each), angle) for each in x])
    transfer = transfer * np.sinc(side * math.cos(angle))
    transfer = transfer * np.sinc(side * math.sin(angle))

    def above(at_um: float) -> float:
        return float((transfer * np.exp(2j * np.pi * f * at_um) / f).imag.sum())

    return float(brentq(above, -0.2, 0.2))


def test_a_disc_s_middle_is_the_mean_of_its_edges() -> None:
    scope = lens((8, 0.05), magnification=60.0)
    # of six angles half a turn apart: one adds nothing, two are mirrored by coma's axis
    first, *twice = (
        math.cos(angle) * edge_um(scope, angle) for angle in (0.0, np.pi / 6, np.pi / 3)
    )
    wanted = 2 * (first + 2 * sum(twice)) / 6
    assert disc_shift_um(scope)[0] == pytest.approx(wanted, rel=0.01)


def test_far_out_of_focus_is_refused_and_the_end_is_finite() -> None:
    scope = lens((8, 0.25), (11, 0.25))
    end = most_defocus_um(scope)
    f = np.linspace(-3, 3, 41)
    for z_um in (end, -end, 0.0):
        change = transfer_change(scope, z_um, f, f)
        assert np.isfinite(change).all()
        assert np.abs(change).max() < 2
    for z_um in (1.01 * end, math.inf, math.nan):
        with pytest.raises(ValueError, match="z_um must be within"):
            transfer_change(scope, z_um, f, f)


def test_a_lamp_as_wide_as_the_lens_changes_nothing() -> None:
    scope = lens((8, 0.05))
    f = np.linspace(-2, 2, 21)
    whole = transfer_change(scope, 2.0, f, 0.5 * f)
    for lamp in (scope.aperture, 0.9):
        other = replace(scope, lamp_aperture=lamp)
        np.testing.assert_array_equal(transfer_change(other, 2.0, f, 0.5 * f), whole)


def test_under_a_pinhole_of_a_lamp_coma_is_its_middle_s_tilt() -> None:
    """sqrt(8) (3 r**3 - 2 r) rises by -2 sqrt(8) in the middle."""
    waves, u = 0.05, np.array([0.1])
    scope = replace(lens((8, waves)), lamp_aperture=0.04)
    change = change_along(scope, 0.0, u, 0.0)[0]
    tilt = -2 * CENTROID * waves * scope.wavelength_um / scope.aperture
    assert change.imag == pytest.approx(math.sin(2 * np.pi * u[0] * tilt), rel=0.1)


def _coma(noll: int, rho: np.ndarray) -> np.ndarray:
    """Return coma of the fourth and of the sixth order along x, of 1 wave rms."""
    if noll == 8:
        return np.asarray(math.sqrt(8) * (3 * rho**3 - 2 * rho))
    return np.asarray(math.sqrt(12) * (10 * rho**5 - 12 * rho**3 + 3 * rho))


@pytest.mark.parametrize(("noll", "waves"), [(8, 0.05), (8, -0.25), (16, 0.1)])
def test_under_a_pinhole_of_a_lamp_edges_are_where_their_phases_meet(
    noll: int, waves: float
) -> None:
    """A faint edge's waves beside the direct light: sin(2 pi (f x + W(f))) / f."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    rho, weights = (nodes + 1) / 2, weights / 2
    at = np.arange(-6, 6, 0.01)  # wavelength / A
    wanted = 0.0
    for k in range(12):
        c = math.cos(math.pi * k / 6)
        phase = rho * at[:, None] + waves * c * _coma(noll, rho)
        level = np.sin(2 * np.pi * phase) @ (weights / rho)
        rise = np.where((level[:-1] <= 0) & (level[1:] > 0), np.diff(level), 0)
        i = int(np.argmax(rise))  # the edge, not a fringe
        wanted += c / 6 * (at[i] - 0.01 * level[i] / rise[i])
    scope = replace(lens((noll, waves)), fill_factor=1e-6)
    scope = replace(scope, lamp_aperture=0.02 * scope.aperture)
    found = disc_shift_um(scope)[0] * scope.aperture / scope.wavelength_um
    assert found == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("noll", [7, 8])
def test_a_disc_lies_where_a_twin_of_another_author_shows_it(noll: int) -> None:
    """A disc of 30 um in pixels of .375 um: the twin's contour is read between them."""
    perfect = twin_pictures.LENS
    lens = replace(perfect, zernike={noll: 0.05})
    wanted = twin_pictures.disc_middle_um(lens) - twin_pictures.disc_middle_um(perfect)
    scope = Microscope(
        aperture=0.42, wavelength_um=0.6, medium_index=1.0, magnification=20.0,
        pitch_um=7.5, width_px=320, height_px=240, wavefront=((noll, 0.05),),
    )  # fmt: skip
    np.testing.assert_allclose(disc_shift_um(scope), wanted, rtol=0, atol=0.005)
    assert np.abs(wanted).max() > 0.04
