"""Light that is computed once and displaced against light computed in place."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.optics.layers.coaxial_light import Irradiance, irradiances
from microplan.optics.layers.lattice import Lattice
from microplan.optics.outline.outline import place
from microplan.optics.render.sampling import margin_error
from microplan.optics.render.scene import Layer, Window
from tests.optics.shapes import disc, gear, microscope

# of a shade: its band, its margin, and reading it between its points
SHADE = 1e-3 + margin_error(12.0) + 1e-3
WIDE = Window(row=-20, column=-20, rows=100, columns=100)
INNER = Window(row=0, column=0, rows=60, columns=60)


def light(
    by_um: tuple[float, float], window: Window, radius_um: float = 20.0
) -> Irradiance:
    """Return the light under a displaced plate 100 um above."""
    outline = place(disc(radius_um), *by_um, 0.0)
    plate = Layer(name="plate", outline=outline, z_um=100.0, reflectance=0.0)
    optics = microscope(6.9, 60, 60)
    (found,) = irradiances(
        (plate,), (0.0,), optics, lamp_aperture=0.42, focus_um=(0.0,), window=window
    )
    return found


@pytest.mark.parametrize("by_um", [(0.0, 0.0), (3.3, -1.7)])
def test_displaced_light_is_that_under_displaced_layers(
    by_um: tuple[float, float],
) -> None:
    there = light(by_um, INNER)
    lattice = Lattice.over((-30.0, -30.0, 30.0, 30.0), there.step_um)
    found = light((0.0, 0.0), WIDE).displaced(by_um).on(lattice)
    assert np.ptp(found) > 0.1
    np.testing.assert_allclose(found, there.on(lattice), rtol=0, atol=SHADE)


def test_shades_of_one_height_add_up_wherever_they_were_computed() -> None:
    here, other = light((0.0, 0.0), INNER, 8.0), light((0.0, 0.0), WIDE, 8.0)
    lattice = Lattice.over((-30.0, -30.0, 30.0, 30.0), here.step_um)
    away = other.displaced((25.0, 0.0))
    for both in (here.with_(away), away.with_(here)):
        assert len(both.shades) == 1
        kept = (1 - here.on(lattice)) + (1 - away.on(lattice))
        np.testing.assert_allclose(1 - both.on(lattice), kept, rtol=0, atol=1e-3)


@pytest.mark.parametrize("height_um", [12.0, 100.0, 300.0])
def test_light_from_few_points_is_the_same(height_um: float) -> None:
    plate = Layer(name="plate", outline=gear(), z_um=height_um, reflectance=0.0)
    optics, lattice = microscope(6.9, 60, 60), Lattice.over((-30, -30, 30, 30), 5.0)
    read, found = (
        irradiances(
            (plate,), (0.0,), optics, lamp_aperture=0.42, focus_um=(3.0,),
            few_points=few,
        )[0].on(lattice)
        for few in (True, False)
    )  # fmt: skip
    assert found.min() < 0.95
    np.testing.assert_allclose(read, found, rtol=0, atol=SHADE)
