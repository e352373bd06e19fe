"""The oracle against closed forms, adaptive quadrature and a raster that converges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0, j1

from microplan.optics.oracle import Oracle, tabulated
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import transfer
from microplan.optics.transfer.otf import diffraction, exact
from tests.optics.shapes import brute_force, disc, microscope, rectangle


def point(magnification: float = 30.0) -> Microscope:
    """Return one pixel without area."""
    return replace(microscope(magnification, 1, 1), fill_factor=1e-12)


@pytest.mark.parametrize("radius_um", [0.3, 2.0, 9.0])
def test_the_middle_of_a_disc_holds_rayleighs_encircled_energy(
    radius_um: float,
) -> None:
    optics = point()
    oracle = Oracle.of(disc(radius_um), optics, wrap_error=1e-7)
    v = 2 * np.pi * optics.aperture / optics.wavelength_um * radius_um
    expected = 1 - j0(v) ** 2 - j1(v) ** 2
    assert abs(oracle.image("exact", 0.0)[0, 0] - expected) < oracle.wrap_error


@pytest.mark.parametrize("z_um", [2.0, -9.0])
def test_a_defocused_disc_is_the_integral_of_its_point_image(z_um: float) -> None:
    optics, radius = point(), 4.0
    A, k = optics.aperture, 2 * np.pi / optics.wavelength_um
    rho, weight = np.polynomial.legendre.leggauss(80)
    rho, weight = (1 + rho) / 2, weight * (1 + rho) / 2
    phase = np.exp(1j * k * z_um * np.sqrt(1 - A**2 * rho**2))

    def ring(r: float) -> float:
        field = (weight * phase) @ j0(k * A * rho * r)
        return float(abs(field) ** 2 * (k * A) ** 2 * r / 2)

    expected, _ = quad(ring, 0, radius, epsabs=1e-10, limit=200)
    oracle = Oracle.of(disc(radius), optics, deepest_um=10.0, wrap_error=1e-7)
    assert abs(oracle.image("exact", z_um)[0, 0] - expected) < oracle.wrap_error


def test_brute_force_closes_in_on_the_oracle() -> None:
    optics = microscope(6.9, 96, 72)
    body = disc(15.0, (3.0, -2.0))
    found = Oracle.of(body, optics, deepest_um=6.0).image("exact", 6.0)
    errors = []
    for samples in (4, 8, 16):  # the raster errs with the square of its step
        raster = brute_force(
            lambda x, y: 15.0 - np.hypot(x - 3.0, y + 2.0),
            optics,
            lambda x: exact(x, z_um=6.0, aperture=0.42, wavelength_um=0.6),
            samples=samples,
        )
        errors.append(float(np.abs(raster - found).max()))
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 2.5e-4  # which is the raster's own


def test_repetitions_cost_what_is_said_at_most() -> None:
    optics, body = microscope(6.9, 24, 20), disc(5.0, (2.0, 1.0))
    laws = [("exact", 0.0), ("hopkins", 20.0)]
    far = Oracle.of(body, optics, deepest_um=20.0, wrap_error=5e-6).images(laws)
    for error in (1e-2, 1e-3, 1e-4):
        near = Oracle.of(body, optics, deepest_um=20.0, wrap_error=error)
        assert 0 < np.abs(near.images(laws) - far).max() < error


def test_a_body_far_beyond_the_window_costs_what_is_said() -> None:
    optics = replace(point(3.0), width_px=9)
    oracle = Oracle.of(rectangle(0, -9e3, 2e4, 9e3), optics, wrap_error=2e-4)
    x = (np.arange(9) - 4) * optics.um_per_px
    cutoff = optics.cutoff_per_um

    def edge(at: float) -> float:
        turn = 2 * np.pi * cutoff * at
        beyond, _ = quad(
            lambda s: float(diffraction(np.array(s))) * np.sinc(turn * s / np.pi),
            *(0.0, 1.0),
            limit=400,
        )
        return 0.5 + turn / np.pi * beyond

    expected = [edge(at) for at in x]
    np.testing.assert_allclose(
        oracle.image("exact", 0.0)[0], expected, rtol=0, atol=oracle.wrap_error
    )


@pytest.mark.parametrize("model", ["product", "stokseth", "hopkins", "exact"])
@pytest.mark.parametrize("z_um", [0.0, 3.0, -60.0])
def test_a_table_is_the_law_within_1e_9(model: str, z_um: float) -> None:
    optics = microscope()
    x = np.random.default_rng(3).uniform(0, 1, 500)
    law = transfer(model, optics, z_um, x * optics.cutoff_per_um)
    found = tabulated(model, optics, z_um)(x)
    np.testing.assert_allclose(found, law, rtol=0, atol=1e-9)
    assert tabulated(model, optics, z_um)(np.array([1.0, 3.0])).tolist() == [0, 0]


def test_a_window_is_a_piece_of_the_frame() -> None:
    optics = microscope(6.9, 30, 22)
    body = disc(8.0, (2.0, 1.0))
    piece = Window(row=-3, column=11, rows=12, columns=9)
    frame = Oracle.of(body, optics, wrap_error=1e-6).image("exact", 4.0)
    found = Oracle.of(body, optics, window=piece, wrap_error=1e-6).image("exact", 4.0)
    np.testing.assert_allclose(found[3:], frame[:9, 11:20], rtol=0, atol=2e-6)


def test_what_was_not_prepared_is_refused() -> None:
    oracle = Oracle.of(disc(2.0), microscope(30.0, 4, 4), deepest_um=5.0)
    with pytest.raises(ValueError, match=r"within 5\.0 um, got -6"):
        oracle.image("exact", -6.0)
    with pytest.raises(ValueError, match="one of geometric"):
        oracle.image("none", 1.0)
