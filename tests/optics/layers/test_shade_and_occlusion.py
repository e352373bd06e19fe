"""Rays on many points and on few of them: the same sums."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from microplan.optics.layers import shade_and_occlusion as crossing
from microplan.optics.layers.coaxial_light import area_um, irradiances
from microplan.optics.layers.lattice import Lattice
from microplan.optics.layers.shade_and_occlusion import joint_shading_residual
from microplan.optics.render.scene import Layer, Window
from tests.optics.shapes import disc, gear, microscope, rectangle

FRAME = Window(row=0, column=0, rows=100, columns=100)


def body(name: str, x_um: float, z_um: float) -> Layer:
    """Return a plate."""
    outline = rectangle(x_um, -60, x_um + 60, 900)
    return Layer(name=name, outline=outline, z_um=z_um, reflectance=0.7)


@pytest.mark.parametrize(
    "layers",
    [
        [body("finger", 20.0, 4.0)],
        [body("finger", 20.0, 4.0), body("other", -90.0, 4.0)],
        [Layer(name="gear", outline=gear(), z_um=-100.0, reflectance=0.8)],
        [
            Layer(name="post", outline=disc(12.0), z_um=-200.0, reflectance=0.3),
            Layer(name="gear", outline=gear(), z_um=-90.0, reflectance=0.8),
            body("finger", 20.0, 4.0),
        ],
    ],
    ids=["sharp", "two alike", "blurred", "three"],
)
@pytest.mark.parametrize("known", [(), (-200.0,)])
def test_one_ray_at_a_time_gives_what_bundles_give(
    layers: Sequence[Layer], known: Sequence[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit by bit: images decide which chain is chosen."""
    optics = microscope(6.9, 100, 100)
    lattice = Lattice.over(area_um(optics, FRAME, (0.0, 0.0), 0.0), 0.55)
    rows, columns = lattice.shape
    assert 1 << 15 < rows * columns < 1 << 16  # one ray in a bundle
    heights = sorted({-200.0, *(layer.z_um for layer in layers)})
    found = irradiances(
        [*layers, body("above", -30.0, 60.0)],
        heights,
        optics,
        lamp_aperture=0.42,
        focus_um=(0.0,),
        window=FRAME,
    )
    shaded = {light.z_um: light for light in found if light.z_um < 0}

    def change() -> np.ndarray:
        return joint_shading_residual(
            layers, (0.1, -200.0), shaded, lattice, optics, focus_um=0.0, known=known
        )

    fast = change()
    monkeypatch.setattr(crossing, "_ray_by_ray", crossing._in_bundles)
    np.testing.assert_array_equal(fast, change())
    assert np.abs(fast).max() > 1e-4
