"""Waves against the closed forms of a circular pupil."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from microplan.executor.simulated.imaging.diffraction import (
    between,
    blurred,
    point_spread,
)
from tests.executor.simulated.imaging.bodies import APERTURE, WAVELENGTH_UM, view

STEP_UM, SIDE = 0.2, 512


def test_a_point_in_focus_is_an_airy_disc() -> None:
    spread = point_spread((SIDE, SIDE), STEP_UM, view(6.9, 0.0), 0.0)
    x = STEP_UM * np.arange(1, 60)
    v = 2 * math.pi * APERTURE * x / WAVELENGTH_UM
    airy = (2 * j1(v) / v) ** 2
    # of a tile of 102 um the wave is periodic: its field there is of order 1 / (pi v)
    np.testing.assert_allclose(spread[0, 1:60] / spread[0, 0], airy, atol=2e-3)
    assert spread.sum() == 1.0 or abs(spread.sum() - 1) < 1e-12


def test_the_middle_of_a_defocused_point_fades_as_the_phase_says() -> None:
    """On the axis the field is the mean of exp(i phase) over the pupil's area."""
    flat = point_spread((SIDE, SIDE), STEP_UM, view(6.9, 0.0), 0.0)[0, 0]
    rho2 = (np.arange(4000) + 0.5) / 4000
    for z in (1.0, 3.4, 9.0):
        path = np.sqrt(1 - APERTURE**2 * rho2) - 1
        field = np.exp(2j * math.pi * z / WAVELENGTH_UM * path).mean()
        found = point_spread((SIDE, SIDE), STEP_UM, view(6.9, 0.0), z)[0, 0] / flat
        # the rim is sampled on 72 cells: the pupil's area is right to 1e-4
        assert abs(found - abs(field) ** 2) < 1e-3


def test_an_edge_is_as_soft_as_its_line_integral_says() -> None:
    """By the transfer function's closed form, without any image of a point."""
    x = STEP_UM * (np.arange(SIDE) - SIDE / 2)
    plane = np.tile(np.clip(0.5 + x / STEP_UM, 0, 1), (64, 1))
    seen = blurred(plane, STEP_UM, view(44.5, 0.0, fill=1e-9), 0.0)[0]
    cutoff = 2 * APERTURE / WAVELENGTH_UM
    f = (np.arange(20000) + 0.5) / 20000 * cutoff
    share = (
        2
        / math.pi
        * (np.arccos(f / cutoff) - f / cutoff * np.sqrt(1 - (f / cutoff) ** 2))
    )
    near = np.abs(x) < 3
    exact = [0.5 + np.mean(share * np.sin(2 * math.pi * f * a) / f) * cutoff / math.pi
             for a in x[near]]  # fmt: skip
    # the tile's other edge, 51 um off, sends lambda / (2 pi**2 A 51 um) = .0014 from
    # both sides; samples of the ramp alias .002
    np.testing.assert_allclose(seen[near], exact, atol=0.003)


def test_between_samples_a_wave_is_what_it_was() -> None:
    rng = np.random.default_rng(3)
    x = np.arange(80) * STEP_UM
    wave = (
        np.cos(2 * math.pi * 1.2 * x)[None, :] * np.cos(2 * math.pi * 0.7 * x)[:, None]
    )
    column, row = rng.uniform(10, 70, (2, 5, 50))
    exact = np.cos(2 * math.pi * 1.2 * STEP_UM * column)
    exact = exact * np.cos(2 * math.pi * 0.7 * STEP_UM * row)
    np.testing.assert_allclose(between(wave, column, row), exact, atol=2e-3)
