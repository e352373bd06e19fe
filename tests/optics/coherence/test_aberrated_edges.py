"""What a wavefront error adds to edges' offsets, against images of edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from microplan.arrays import FloatArray
from microplan.optics.coherence.aberrated_edges import aberrated_offsets_um
from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.dilation import dilation_um, uneven_um
from microplan.optics.coherence.edge_offsets import edge_offset_um
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope, Terms
from tests.optics.shapes import microscope, rectangle

AIRY_UM = 0.6 / 0.42
WITHIN_UM = 0.003  # .002 wavelength / A


def scope(*terms: tuple[int, float]) -> Microscope:
    return replace(microscope(44.5, 131, 41), fill_factor=1e-6, wavefront=terms)


def bright_sides_um(lens: Microscope, coherence: float, dark: float) -> FloatArray:
    """Return how far the sides at -8 and 8 um of a bright bar move inwards, (2,)."""
    bar = Layer(
        name="bar", outline=rectangle(-8.0, -60.0, 8.0, 60.0), z_um=0.0, reflectance=1.0
    )
    scene, middle = (
        Scene(layers=(bar,), background=dark),
        Window(row=20, column=0, rows=1, columns=lens.width_px),
    )
    if coherence:
        line = render_coherent(
            scene, lens, focus_um=0.0, coherence=coherence, window=middle, samples=10
        )[0]
    else:
        line = render(scene, lens, focus_um=0.0, window=middle)[0]
    x = (np.arange(lens.width_px) - (lens.width_px - 1) / 2) * lens.um_per_px
    roots = CubicSpline(x, line - (1 + dark) / 2).roots(extrapolate=False)
    return np.array([roots[0] + 8.0, 8.0 - roots[-1]])


@pytest.mark.parametrize(
    ("terms", "coherence", "dark"),
    [
        (((8, 0.05),), 0.6, 0.0),
        (((8, 0.05),), 0.3, 0.25),
        (((11, 0.05),), 0.2, 0.0),
        (((6, 0.1), (8, -0.04)), 0.4, 0.0),
    ],
)
def test_images_of_edges_move_by_it(
    terms: Terms, coherence: float, dark: float
) -> None:
    contrast = 1 - dark**0.5
    found = aberrated_offsets_um(coherence, scope(*terms), contrast)
    # normals into the bright side: along x at the left side, against it at the right
    two = found[[0, found.size // 2]]
    images = [
        bright_sides_um(lens, s, dark)
        for lens in (scope(*terms), scope())
        for s in (coherence, 0.0)
    ]
    wanted = images[0] - images[1] - (images[2] - images[3])
    np.testing.assert_allclose(two, wanted, rtol=0, atol=WITHIN_UM)
    assert np.abs(wanted).max() > 2 * WITHIN_UM


def test_an_error_along_y_or_of_the_other_sign_is_that_along_x_turned() -> None:
    along, up, against = (
        aberrated_offsets_um(0.4, scope(term), 1.0)
        for term in ((8, 0.06), (7, 0.06), (8, -0.06))
    )
    quarter = along.size // 4
    np.testing.assert_allclose(up, np.roll(along, quarter), atol=WITHIN_UM)
    np.testing.assert_allclose(against, np.roll(along, 2 * quarter), atol=WITHIN_UM)


def test_nothing_is_added_without_an_error_a_contrast_or_coherence() -> None:
    assert not aberrated_offsets_um(0.4, scope(), 1.0).any()
    assert not aberrated_offsets_um(0.4, scope((8, 0.05)), 0.0).any()
    wide = aberrated_offsets_um(4.0, scope((8, 0.05), (11, 0.05)), 1.0)
    assert np.abs(wide).max() < WITHIN_UM


def test_the_dilation_of_a_stated_light_has_it() -> None:
    light, lens = Coherence(least=0.3, most=0.3), scope((8, 0.05))
    added = aberrated_offsets_um(0.3, lens, 1.0)
    usual = edge_offset_um(0.3, lens, 1.0)
    middle, uneven = dilation_um(light, lens, 1.0)[1], uneven_um(light, lens, 1.0)
    assert middle - uneven == pytest.approx(usual + added.min())
    assert middle + uneven == pytest.approx(usual + added.max())
    assert uneven_um(light, scope(), 1.0) == uneven_um(None, lens, 1.0) == 0
    unknown = Coherence(least=0.0, most=1.0, is_stated=False)
    plain = dilation_um(unknown, scope(), 1.0)
    assert dilation_um(unknown, lens, 1.0)[1] >= plain[1] + middle - usual
