"""Spectrum and polarisation against integrals over the image instead of the pupil."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, special

from microplan.optics.coherence.unmodelled import (
    spectrum_error,
    vectorial_error,
    vectorial_otf,
)
from microplan.optics.transfer.models import transfer
from tests.optics.shapes import microscope


def richards_wolf(r: float, sine: float) -> float:
    """Return the intensity r wavelengths from a point's image, unpolarised light.

    Richards and Wolf, Proc. R. Soc. A 253 (1959) 358, their I0, I1 and I2.
    """

    def ring(order: int, of: Callable[[float], float]) -> float:
        def integrand(angle: float) -> float:
            s = math.sin(angle)
            bessel = special.jv(order, 2 * math.pi * r * s)
            return float(math.sqrt(math.cos(angle)) * s * of(math.cos(angle)) * bessel)

        return float(integrate.quad(integrand, 0, math.asin(sine), epsabs=1e-12)[0])

    i0 = ring(0, lambda c: 1 + c)
    i1 = ring(1, lambda c: math.sqrt(1 - c * c))
    i2 = ring(2, lambda c: 1 - c)
    return i0**2 + 2 * i1**2 + i2**2


@pytest.mark.parametrize("sine", [0.1, 0.42, 0.9])
def test_the_vectorial_transfer_gives_the_diffraction_integrals(sine: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(80)
    x = (nodes + 1) / 2
    otf = vectorial_otf(x, sine)

    def spread(r: float) -> float:
        # r in wavelengths, the cutoff is 2 sine per wavelength
        wave = special.j0(4 * np.pi * sine * r * x)
        return float(weights @ (otf * wave * x))

    for r in (0.2 / sine, 0.5 / sine, 1.1 / sine):
        expected = richards_wolf(r, sine) / richards_wolf(0.0, sine)
        # the 50 nodes each way of the overlap and 80 of this integral
        assert spread(r) / spread(0.0) == pytest.approx(expected, abs=1e-6)


def test_a_small_aperture_has_no_vectors() -> None:
    x = np.linspace(0.0, 1.0, 21)
    optics = microscope()
    scalar = transfer("exact", optics, 0.0, x * optics.cutoff_per_um)
    # the field's components along the axis carry sine**2 / 2 of the light
    assert np.abs(vectorial_otf(x, 1e-3) - scalar).max() < 1e-6
    steep = [np.abs(vectorial_otf(x, s) - scalar).max() for s in (0.1, 0.2)]
    assert steep[1] / steep[0] == pytest.approx(4.0, rel=0.05)


def test_errors_at_the_papers_aperture() -> None:
    optics = microscope()
    assert optics.aperture == 0.42
    x = np.linspace(0.0, 1.0, 101)
    scalar = transfer("exact", optics, 0.0, x * optics.cutoff_per_um)
    otf = np.abs(vectorial_otf(x, 0.42) - scalar).max()
    assert otf == pytest.approx(0.0188, abs=1e-4)
    assert vectorial_error(optics) == pytest.approx(0.0073, abs=1e-4)


@pytest.mark.parametrize("z_um", [0.0, 6.0])
def test_a_band_is_the_mean_of_its_colours(z_um: float) -> None:
    """An edge by adaptive integrals of each colour, at one place."""
    optics, width = microscope(), 0.3
    found = spectrum_error(optics, z_um, width)

    def edge(x_um: float, wavelength_um: float) -> float:
        colour = replace(optics, wavelength_um=wavelength_um)

        def wave(f: float) -> float:
            seen = transfer("exact", colour, z_um, np.array([f]))[0]
            return float(seen * math.sin(2 * math.pi * f * x_um) / (math.pi * f))

        return float(integrate.quad(wave, 0, colour.cutoff_per_um, limit=200)[0])

    mean = optics.wavelength_um
    nodes, weights = np.polynomial.legendre.leggauss(6)
    errors = []
    for x_um in np.linspace(0.1, 2.0, 12):
        colours = [edge(x_um, mean * (1 + width / 2 * n)) for n in nodes]
        errors.append(abs(float(weights @ colours) / 2 - edge(x_um, mean)))
    # the twelve places need not hold the very largest
    assert 0.6 * found < max(errors) < found * 1.02
    assert spectrum_error(optics, z_um, 0.0) < 1e-12


def test_spectra_and_sines_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="bandwidth"):
        spectrum_error(microscope(), 0.0, 1.0)
    with pytest.raises(ValueError, match="z_um"):
        spectrum_error(microscope(), math.nan)
    for sine in (0.0, 1.0, math.nan):
        with pytest.raises(ValueError, match="sine"):
            vectorial_otf(np.array([0.5]), sine)
