"""A halo as wide as it is, beside an edge that runs on: against the normal integral."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from microplan.optics.render.render import cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Window
from tests.optics.shapes import microscope, rectangle

SAMPLINGS = (Sampling(), Sampling(band_error=2e-3, margin=12.0, near=12.0, single=True))


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize(("radius_um", "share"), [(20.0, 0.5), (10.0, 0.06)])
@pytest.mark.parametrize("row", [170, 200])
def test_a_halo_does_not_wrap_round_the_tile(
    sampling: Sampling, radius_um: float, share: float, row: int
) -> None:
    scope = microscope(7.0, 640, 480)
    half = Layer(name="half", outline=rectangle(-2e3, -2e3, 2e3, 0.0), z_um=-8.0,
                 reflectance=1.0)  # fmt: skip
    window = Window(row=row, column=280, rows=40, columns=80)
    plain, hazy = (
        cover([half], lens, focus_um=0.0, window=window, sampling=sampling)[0].coverage
        for lens in (scope, replace(scope, halo=(radius_um, share)))
    )
    up_um = (239.5 - row - np.arange(40)) * scope.um_per_px
    wanted = (1 - share) * plain + share * ndtr(-up_um / radius_um)[:, None]
    # the lens blurs the halo, too, by a few um
    np.testing.assert_allclose(hazy, wanted, rtol=0, atol=0.005)
