"""Halos: light that is spread, none that is lost, a Gaussian around a point."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.executor.simulated.imaging.halo import halo_px, halo_window, with_halo
from microplan.executor.simulated.imaging.imaging_view import Halo, PixelWindow
from microplan.executor.simulated.imaging.photograph import photograph
from tests.executor.simulated.imaging.bodies import body, box, circle, scene, view

VIEW = replace(view(20.0, 30.0), halo=Halo(radius_um=2.5, share=0.1))
WINDOW = PixelWindow(row=215, column=290, rows=50, columns=60)


def test_a_point_gets_a_gaussian_around_it() -> None:
    skirt, scale = halo_px(VIEW), VIEW.px_per_um
    wide = halo_window(VIEW, PixelWindow(row=0, column=0, rows=41, columns=41))
    light = np.zeros((wide.rows, wide.columns))
    light[skirt + 20, skirt + 20] = 1.0
    seen = with_halo(light, VIEW)
    y, x = np.mgrid[-20:21, -20:21] / (2.5 * scale)
    wanted = 0.1 * np.exp(-(x**2 + y**2) / 2) / (2 * math.pi * (2.5 * scale) ** 2)
    wanted[20, 20] += 0.9
    # beyond 3.5 sigmas it comes back from the other side: exp(-3.5**2 / 2) of its top
    np.testing.assert_allclose(seen, wanted, atol=0.003 * wanted[20, 19])


def test_an_even_field_stays_as_it_is() -> None:
    light = photograph(scene(), VIEW, WINDOW)
    plain = photograph(scene(), replace(VIEW, halo=Halo()), WINDOW)
    np.testing.assert_allclose(light, plain, atol=1e-12)


@pytest.mark.parametrize("radius_um", [0.3, 1.0, 3.0])
def test_a_halo_keeps_the_mean_light(radius_um: float) -> None:
    """Of a small disc alone on black, in a window that holds all of its halo."""
    disc = scene(body([circle(2, 1, 4)], 29.0, 30.0, 0.9), stage=0.0)
    window = PixelWindow(row=190, column=270, rows=100, columns=100)
    lens = replace(VIEW, halo=Halo(radius_um=radius_um, share=0.3))
    light = photograph(disc, lens, window)
    plain = photograph(disc, replace(lens, halo=Halo()), window)
    # of the disc's light .9 % is beyond 16 um, and the planes' tiles fold it otherwise
    assert light.mean() == pytest.approx(plain.mean(), rel=2e-3)
    assert np.abs(light - plain).max() > 0.005


def test_an_edge_gets_the_error_function() -> None:
    face = scene(body([box(-200, -200, 0, 200)], 0.0, 30.0, 0.9), stage=0.1)
    window = PixelWindow(row=235, column=300, rows=10, columns=40)
    light = photograph(face, VIEW, window)
    plain = photograph(face, replace(VIEW, halo=Halo()), window)
    x = (np.arange(300, 340) - 319.5) / VIEW.px_per_um
    rise = np.array([math.erf(v / (2.5 * math.sqrt(2))) for v in x])
    step, dark = 0.8, 0.1
    wanted = 0.1 * (dark + step * (1 - rise) / 2 - plain.mean(axis=0))
    # the face's wall shades the stage beside it: .1 of a share, of stage's .1
    np.testing.assert_allclose((light - plain).mean(axis=0), wanted, atol=0.006)


def test_no_halo_is_no_change_and_takes_no_skirt() -> None:
    for none in (Halo(), Halo(radius_um=3.0), Halo(share=0.2)):
        lens = replace(VIEW, halo=none)
        assert halo_window(lens, WINDOW) == WINDOW
        light = np.ones((4, 5))
        assert with_halo(light, lens) is light


@pytest.mark.parametrize("bad", [(-1.0, 0.1), (1.0, 1.0), (1.0, -0.1), (math.nan, 0.1)])
def test_what_is_no_halo_is_refused(bad: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="no halo"):
        Halo(radius_um=bad[0], share=bad[1])
