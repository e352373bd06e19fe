"""Diffraction from face to face against Fresnel's integrals and waves on a line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import fresnel

from benchmarks.optics.layer_waves import line
from microplan.arrays import FloatArray
from microplan.optics.layers.diffraction.face_waves import wave_changes
from microplan.optics.layers.layer_edges import faces
from microplan.optics.layers.ray_probes import probes
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.render.view_range import full
from tests.optics.shapes import rectangle
from tests.optics.wave import behind_a_mask, places

OPTICS = line(360)
AIRY = OPTICS.wavelength_um / OPTICS.aperture
DEPTH = OPTICS.wavelength_um / OPTICS.aperture**2
FAR_OFF = 150.0  # wavelength / A


def edges(low: tuple[float, float], high: tuple[float, float]) -> Scene:
    """Return a white plate left of an edge under a black one right of another.

    Edge and height of each, in wavelength / A and in n wavelength / A**2.
    """
    sides = ((-FAR_OFF, low[0]), (high[0], FAR_OFF))
    layers = [
        Layer(
            name=name,
            outline=rectangle(a * AIRY, -FAR_OFF * AIRY, b * AIRY, FAR_OFF * AIRY),
            z_um=z * DEPTH,
            reflectance=tone,
        )
        for name, (a, b), z, tone in (
            ("low", sides[0], low[1], 1.0),
            ("high", sides[1], high[1], 0.0),
        )
    ]
    return Scene(layers=tuple(layers), background=0.0)


def changes(scene: Scene, x: FloatArray, light: float = 1.0) -> FloatArray:
    at_um = np.stack([x * AIRY, np.zeros_like(x)], axis=1)
    found = faces(scene, OPTICS, 0.0, full(OPTICS))
    rasters = probes(OPTICS, found, at_um)
    return wave_changes(
        rasters, np.full((len(found), len(x)), light), 0.0, OPTICS, at_um
    )


@pytest.mark.parametrize("z", [0.0, 6.0, 40.0])
def test_one_face_alone_is_as_it_is_blended(z: float) -> None:
    scene = edges((0.0, z), (0.0, z + 9.0))
    for kept in scene.layers:
        alone = Scene(layers=(kept,), background=0.0)
        found = changes(alone, np.linspace(-3, 3, 7))
        np.testing.assert_allclose(found, 0, atol=1e-5)  # single precision


@pytest.mark.parametrize(
    ("low_z", "high_z"), [(-14.0, 14.0), (-30.0, 30.0), (14.0, 60.0)]
)
def test_far_edges_diffract_as_by_fresnel(low_z: float, high_z: float) -> None:
    """The shadow of a knife's edge over chords of the pupil, cut by the lower edge."""
    u = (np.arange(-4000, 4000) + 0.5) / 4000  # of the rim
    chords = 2 / np.pi * np.sqrt(1 - u**2) / 4000
    s, c = fresnel(-u * np.sqrt(2 / abs(1 / low_z - 1 / high_z)))
    shadow = 0.5 * ((0.5 + c) ** 2 + (0.5 + s) ** 2)
    found, expected = [], []
    for cut in np.linspace(-0.3, 0.3, 13):
        # through the point 0; the high edge passes the middle of the pupil
        scene = edges((cut * low_z, low_z), (0.0, high_z))
        found.append(changes(scene, np.zeros(1))[0])
        white = u * low_z < cut * low_z
        expected.append(float((chords * (shadow - (u < 0)))[white].sum()))
    # edges are soft over .05 of the pupil, a raster's cell, of fringes .17 to .27 wide:
    # the peaks between them lose up to half, which the search's factor of 2 gives back
    assert np.corrcoef(found, expected)[0, 1] > 0.9
    assert 0.5 < np.abs(found).max() / np.abs(expected).max() < 1.1


@pytest.mark.parametrize("high_z", [3.0, 8.0, 30.0])
def test_an_edge_in_focus_behind_another_is_as_by_waves(high_z: float) -> None:
    x = places(768, 0.0875)
    at = x[384 - 17 : 384 + 18 : 6]
    back, front = (x < 0).astype(np.float64), (x > 0.35 * high_z).astype(np.float64)
    even = np.ones_like(x)
    both, low, free = (
        behind_a_mask(x, b, m, high_z, 0.0)[384 - 17 : 384 + 18 : 6]
        for b, m in ((back, 1 - front), (back, even), (even, 1 - front))
    )
    found = changes(edges((0.0, 0.0), (0.35 * high_z, high_z)), at)
    assert np.abs(both - low * free).max() > 0.03
    # what an edge sends beyond 3 times the rim, and the judge's period of 67
    np.testing.assert_allclose(found, both - low * free, rtol=0, atol=0.012)


def test_light_scales_what_is_seen() -> None:
    scene, x = edges((0.0, 0.0), (2.0, 20.0)), np.array([-0.4, 0.3])
    np.testing.assert_allclose(
        changes(scene, x, 0.25), 0.25 * changes(scene, x), rtol=1e-3, atol=1e-6
    )
