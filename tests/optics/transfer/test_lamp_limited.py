"""The transfer under a narrow lamp against sums over its disc, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.transfer.lamp_limited import lamp_limited
from microplan.optics.transfer.otf import exact

APERTURE, WAVE = 0.42, 0.6


def summed(x: FloatArray, z_um: float, lamp: float) -> FloatArray:
    """Return the mean over points of the lamp's disc of the displaced pupil's wave."""
    s, side = lamp / APERTURE, 400
    g = (np.arange(-side, side) + 0.5) / side * s
    u, v = (a[np.hypot(*np.meshgrid(g, g)) < s] for a in np.meshgrid(g, g))

    def height(r2: FloatArray) -> FloatArray:
        return np.sqrt(1 - APERTURE**2 * np.minimum(r2, 1.0))

    found = []
    for f in 2 * x:
        r2 = (u + f) ** 2 + v**2
        phase = 2 * math.pi / WAVE * z_um * (height(r2) - height(u**2 + v**2))
        found.append((np.cos(phase) * (r2 < 1)).mean())
    return np.array(found)


@pytest.mark.parametrize("z_um", [0.0, 5.0, 15.0])
@pytest.mark.parametrize("lamp", [0.1, 0.3])
def test_it_is_the_mean_over_the_lamp(z_um: float, lamp: float) -> None:
    x = np.linspace(0, 1, 11)
    found = lamp_limited(
        x, z_um=z_um, aperture=APERTURE, lamp_aperture=lamp, wavelength_um=WAVE
    )
    # 800 points across a disc: its rim and the pupil's are off by a part of one
    np.testing.assert_allclose(found, summed(x, z_um, lamp), atol=1e-3)


@pytest.mark.parametrize("z_um", [0.0, 2.5, 10.0, 50.0])
def test_a_lamp_as_wide_as_the_lens_is_incoherent(z_um: float) -> None:
    x = np.linspace(0, 1, 60)
    found = lamp_limited(
        x, z_um=z_um, aperture=APERTURE, lamp_aperture=APERTURE, wavelength_um=WAVE
    )
    same = exact(x, z_um=z_um, aperture=APERTURE, wavelength_um=WAVE)
    # where rays alone serve, they miss .005 of a transfer that is below .01
    np.testing.assert_allclose(found, same, atol=6e-3 if z_um == 50 else 1e-6)


def test_what_cannot_be_is_refused() -> None:
    x = np.zeros(1)
    for lamp, z_um in ((0.5, 0.0), (0.0, 0.0), (0.3, math.nan)):
        with pytest.raises(ValueError, match=r"need|finite"):
            lamp_limited(
                x, z_um=z_um, aperture=APERTURE, lamp_aperture=lamp, wavelength_um=WAVE
            )
