"""Fourier integrals against adaptive quadrature and closed forms of whole shapes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from microplan.optics.outline.clip import to_edges
from microplan.optics.outline.fourier_integral import transform
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from tests.optics.shapes import disc, rectangle


def cap() -> Outline:
    """Return a half disc of 5 um about (2, 1), its flat side below."""
    arc = Arc(center=(2.0, 1.0), radius_um=5.0, start_rad=0.0, sweep_rad=math.pi)
    return Outline(rings=(Ring(edges=(arc, Segment(start=arc.end, end=arc.start))),))


@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (0.03, -0.2), (0.5, 0.0), (0.2, 0.7)])
def test_a_coefficient_is_the_integral_over_the_area(u: float, v: float) -> None:
    def part(wave: np.ufunc) -> float:
        value, _ = dblquad(
            lambda y, x: wave(2 * np.pi * (u * x + v * y)),
            *(-3.0, 7.0),
            1.0,
            lambda x: 1 + math.sqrt(max(25 - (x - 2) ** 2, 0)),
            epsabs=1e-8,
        )
        return float(value)

    found = transform(to_edges(cap()), np.array([u]), np.array([v]))[0, 0]
    assert abs(found - (part(np.cos) - 1j * part(np.sin))) < 1e-6  # asked for 1e-8


def test_segments_give_the_closed_form_of_a_rectangle() -> None:
    u, v = np.r_[0, np.geomspace(1e-12, 3, 60)], np.r_[0, np.geomspace(1e-12, 3, 50)]
    found = transform(to_edges(rectangle(100, -3, 107, 30)), u, v)
    wave = np.exp(-2j * np.pi * (103.5 * u + 13.5 * v[:, None]))
    expected = 7 * 33 * np.sinc(7 * u) * np.sinc(33 * v)[:, None] * wave
    # the rounding of a phase of 2 pi 340, and 1e-12 of the area where terms cancel
    assert np.abs(found - expected).max() < 7 * 33 * 4e-12


def test_panels_give_the_bessel_form_of_a_circle() -> None:
    pieces = tuple(
        Arc(center=(3.0, 4.0), radius_um=40.0, start_rad=a, sweep_rad=s)
        for a, s in ((0.1, 0.4), (0.5, 3.0), (3.5, 2 * math.pi - 3.4))
    )
    u, v = np.r_[0, np.geomspace(1e-9, 2, 40)], np.r_[0, np.geomspace(1e-9, 2, 30)]
    found = transform(to_edges(Outline(rings=(Ring(edges=pieces),))), u, v)
    whole = transform(to_edges(disc(40.0, (3.0, 4.0))), u, v)
    assert np.abs(found - whole).max() < np.pi * 40**2 * 4e-12
