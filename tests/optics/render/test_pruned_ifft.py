"""Sums of waves at any places, against the same sums wave by wave."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.optics.render.pruned_ifft import waves_at


@pytest.mark.parametrize("orders", [(0, 0), (3, 0), (0, 4), (7, 5), (400, 300)])
@pytest.mark.parametrize(
    ("kind", "most"), [(np.complex128, 1e-12), (np.complex64, 1e-6)]
)
def test_waves_are_summed(
    orders: tuple[int, int], kind: type[np.complexfloating], most: float
) -> None:
    J, K = orders
    rng = np.random.default_rng(J + K)
    parts = rng.standard_normal((2, 2 * K + 1, J + 1))
    values = (parts[0] + 1j * parts[1]).astype(kind)
    y, x = np.array([-0.5, 0.0, 0.37, 1.0, 2.25]), np.array([0.0, 0.5, 0.913])
    found = waves_at(values, y, x)
    assert found.dtype == values.real.dtype
    k = np.r_[0 : K + 1, -K:0]
    for row, up in enumerate(y):
        for column, right in enumerate(x):
            waves = np.exp(2j * np.pi * (k[:, None] * up + np.arange(J + 1) * right))
            sums = (values * waves).real.sum(axis=0)
            exact = sums[0] + 2 * sums[1:].sum()
            assert abs(found[row, column] - exact) < most * np.abs(values).sum()
