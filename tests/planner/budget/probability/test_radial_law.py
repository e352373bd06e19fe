"""Laws of a radius whose parts differ by orders of magnitude."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.budget.probability.radial_law import LEAST_SHARE, radial_law


@pytest.mark.parametrize("rest_um", [1e-3, 1.0, 1e3, 1e8])
def test_a_law_is_nowhere_finer_than_its_scale_by_much(rest_um: float) -> None:
    """Else edges are cut into as many pieces as there is no memory for."""
    law = radial_law(Residual(sigma_um=0.57, within_um=1.45), rest_um)
    assert law.scale_um >= LEAST_SHARE * rest_um
    assert law.reach_um / law.scale_um < 1e4
    if rest_um >= 1e3:  # then it is Rayleigh's, but for a millionth
        radius = np.array([0.5, 1.0, 2.0]) * rest_um
        expected = np.exp(-((radius / rest_um) ** 2) / 2)
        assert law.tail(radius) == pytest.approx(expected, rel=1e-4)
