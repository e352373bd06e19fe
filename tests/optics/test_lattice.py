"""Reading a lattice between its points, in one piece or block by block."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from optics.lattice import Lattice
from optics.scene import Window


@pytest.mark.parametrize(
    ("step_um", "count"), [(0.37, 4040), (1.0, 1490), (2.5, 600), (-0.5, 3000)]
)
def test_many_points_are_read_as_by_one_spline(step_um: float, count: int) -> None:
    lattice = Lattice(
        step_um=1.0, window=Window(row=-3, column=0, rows=7, columns=1500)
    )
    values = np.random.default_rng(1).standard_normal(lattice.shape)
    first = 2.25 if step_um > 0 else 1499.5  # half a point from the last one, or so
    places = (first, step_um, count)
    found = lattice.read(values, places, (3.0, -1.0, 7), beyond_um=1.0)
    at = np.clip(first + step_um * np.arange(count), 0, 1499)
    spline = CubicSpline(np.arange(1500), values, axis=1)(at)
    np.testing.assert_allclose(found, spline, atol=1e-12)


def test_places_beyond_many_points_are_refused() -> None:
    lattice = Lattice(step_um=1.0, window=Window(row=0, column=0, rows=7, columns=1500))
    values = np.zeros(lattice.shape)
    for first in (-2.0, 3.0):  # the last of 1500 is at 1499
        with pytest.raises(ValueError, match="so wide a window"):
            lattice.read(values, (first, 1.0, 1500), (0.0, -1.0, 7), beyond_um=1.0)
