"""Images through a lens with a halo, against those of another author."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import Polygon

from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Halo
from tests.optics.shapes import microscope, polygon
from validation.twins import optics, scenes

POINTS = [(-8.0, -6.0), (9.0, -6.0), (9.0, 5.0), (-3.0, 5.0), (-3.0, 1.0), (-8.0, 1.0)]
SCOPE = replace(microscope(20.0, width_px=72, height_px=56), pitch_um=8.0)
LAYER = Layer(name="a", outline=polygon(POINTS), z_um=0.0, reflectance=0.8)


def ours(halo: Halo | None) -> np.ndarray:
    scope = replace(SCOPE, halo=halo)
    return render(Scene(layers=(LAYER,), background=0.1), scope, focus_um=0.0)


def twin(halo: Halo | None) -> np.ndarray:
    body = scenes.Body(shape=Polygon(POINTS), reflectance=0.8, z_um=0.0)
    lens = optics.Optics(aperture=0.42, wavelength_um=0.6, halo=halo)
    return optics.image(
        scenes.Scene(bodies=(body,), background=0.1), lens, (56, 72), 0.4
    )


@pytest.mark.parametrize("halo", [(1.0, 0.1), (3.0, 0.05), (3.0, 0.4)])
def test_the_change_is_the_twins(halo: Halo) -> None:
    wanted, found = twin(halo) - twin(None), ours(halo) - ours(None)
    assert wanted.std() > 1e-3
    assert (found - wanted).std() < 0.02 * wanted.std()


def test_a_halo_of_no_light_changes_nothing() -> None:
    np.testing.assert_array_equal(ours((2.0, 0.0)), ours(None))


@pytest.mark.parametrize("halo", [(0.0, 0.1), (1.0, 1.0), (1.0, -0.1)])
def test_a_halo_that_is_none_is_refused(halo: Halo) -> None:
    with pytest.raises(ValueError, match="halo must be"):
        replace(SCOPE, halo=halo)
