"""Reading a lattice between its points, in one piece or block by block."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft
from scipy.interpolate import CubicSpline

from microplan.optics.layers.lattice import Lattice, blur, continued
from microplan.optics.outline.cell_areas import CHORD_UM
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.models import transfer
from tests.optics.shapes import gear, microscope, rectangle


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


def test_values_that_are_missing_are_the_nearest_ones() -> None:
    values = np.arange(12.0).reshape(3, 4)
    values[:, 2:] = np.nan
    found = continued(values)
    np.testing.assert_array_equal(found[:, :2], values[:, :2])
    np.testing.assert_array_equal(found[:, 2:], values[:, 1:2].repeat(2, axis=1))
    np.testing.assert_array_equal(continued(np.full((2, 3), np.nan)), np.zeros((2, 3)))


def test_places_beyond_many_points_are_refused() -> None:
    lattice = Lattice(step_um=1.0, window=Window(row=0, column=0, rows=7, columns=1500))
    values = np.zeros(lattice.shape)
    for first in (-2.0, 3.0):  # the last of 1500 is at 1499
        with pytest.raises(ValueError, match="so wide a window"):
            lattice.read(values, (first, 1.0, 1500), (0.0, -1.0, 7), beyond_um=1.0)


def test_a_blur_in_single_precision_is_that_in_double() -> None:
    """Lengths of 96 and 128 transform fast as they are."""
    optics, values = microscope(6.9, 64, 48), np.random.default_rng(2).random((96, 128))
    v, u = (np.arange(size) / (2 * size) for size in values.shape)
    f = np.hypot(u, v[:, None])
    gain = transfer("exact", optics, 30.0, f)
    gain *= np.sinc(u * optics.um_per_px) * np.sinc(v * optics.um_per_px)[:, None]
    expected = fft.idctn(fft.dctn(values) * gain)
    found = blur(values, 1.0, optics, "exact", 30.0)
    # of the tables 2e-5 a frequency; of single precision 1e-6
    scale = np.sqrt(np.mean(values**2))
    assert np.sqrt(np.mean((found - expected) ** 2)) < 2.1e-5 * scale


def test_a_blur_of_any_length_keeps_what_is_even() -> None:
    optics = microscope(6.9, 64, 48)
    for shape in ((97, 113), (13, 211), (1, 7)):
        even = np.full(shape, 0.7)
        found = blur(even, 0.5, optics, "exact", 20.0)
        np.testing.assert_allclose(found, even, rtol=0, atol=1e-6)


def test_held_cells_are_the_cells_of_any_part() -> None:
    layer = Layer(name="gear", outline=gear(), z_um=0.0, reflectance=0.8)
    for row, column, rows, columns in ((-90, -80, 70, 50), (-83, -61, 100, 130)):
        window = Window(row=row, column=column, rows=rows, columns=columns)
        lattice = Lattice(step_um=0.7, window=window)
        found = lattice.held_cells(layer)
        assert found.shape == lattice.shape
        assert not found.flags.writeable
        # chords that stand for an arc start where a lattice cuts it, and a cell has an
        # edge as long as its diagonal
        atol = 2**0.5 * CHORD_UM / lattice.step_um
        np.testing.assert_allclose(found, lattice.cells(layer), rtol=0, atol=atol)


@pytest.mark.parametrize("outline", [gear(), rectangle(-900.0, -500.0, 900.0, 60.0)])
@pytest.mark.parametrize("step_um", [0.7, 3.0])
def test_of_few_rays_distances_say_what_cells_cover(
    outline: Outline, step_um: float
) -> None:
    """A gear, and a plate that is too large for a fine grid, turned and moved."""
    outline = place(outline, 13.7, -5.2, 0.4)
    layer = Layer(name="body", outline=outline, z_um=0.0, reflectance=0.8)
    lattice = Lattice.over((-300.0, -100.0, 300.0, 100.0), step_um)
    exact, found = lattice.cells(layer), lattice.covered(layer, 0.5)
    edge = (exact > 0) & (exact < 1)
    off = np.abs(found - exact)
    assert edge.sum() > 150
    assert off.max() < 0.3  # in corners
    assert np.quantile(off[edge], 0.9) < 0.1
    assert abs(found.mean() - exact.mean()) < 0.002
    every = lattice.covered(layer, 1.0)
    np.testing.assert_array_equal(every, lattice.held_cells(layer))
