"""The correction of small tiles against tiles with all of the margin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from microplan.optics.outline.clip import to_edges
from microplan.optics.outline.outline import Outline
from microplan.optics.render.far_field import highest_per_um
from microplan.optics.render.render import render
from microplan.optics.render.sampling import FAR_ERROR, NEAR, Sampling, margin_error
from microplan.optics.render.tiled_layer import TiledLayer, make_part
from microplan.optics.render.view_range import Range, full
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction
from tests.optics.shapes import disc, gear, microscope, one_layer, rectangle

# All of the band: where it is cut depends on the orders of the tile.
WHOLE = Sampling(band_error=1e-12, margin=80.0)
SHAPES = {
    "a part that leaves the frame": gear(),
    "a plate that crosses it": rectangle(-3000.0, -20.0, 3000.0, 3.0),
    "a plate beside it": rectangle(-2000.0, 60.0, 3000.0, 2000.0),
    "a part inside": disc(6.0, (1.0, 2.0)),
    "all but a quarter": rectangle(-9.0, -6.0, 2000.0, 2000.0),
}


def _part(outline: Outline, optics: Microscope, sampling: Sampling) -> TiledLayer:
    found = make_part(
        one_layer(outline).layers[0],
        to_edges(outline),
        optics,
        reach=Range(focus_um=(0.0, 0.0)),
        model="exact",
        window=full(optics),
        sampling=sampling,
    )
    assert found is not None
    return found


@pytest.mark.parametrize("z_um", [0.0, 12.0])
@pytest.mark.parametrize("magnification", [6.9, 44.5])
@pytest.mark.parametrize("name", SHAPES)
def test_a_small_tile_shows_what_a_large_one_does(
    name: str, magnification: float, z_um: float
) -> None:
    optics = microscope(magnification)
    images = [
        render(one_layer(SHAPES[name]), optics, focus_um=z_um, sampling=sampling)
        for sampling in (WHOLE, replace(WHOLE, near=WHOLE.margin))
    ]
    assert np.abs(images[0] - images[1]).max() < FAR_ERROR


def test_without_the_correction_repetitions_show() -> None:
    optics, scene = microscope(44.5), one_layer(gear())
    whole = render(scene, optics, focus_um=0.0, sampling=WHOLE)
    short = Sampling(band_error=1e-12, margin=NEAR)
    bare = render(scene, optics, focus_um=0.0, sampling=short)
    assert np.abs(whole - bare).max() > 5 * FAR_ERROR


@pytest.mark.parametrize("row", [0, -1])
def test_an_edge_out_of_sight_gives_its_light(row: int) -> None:
    # 15 wavelengths / A above the axis, outside the frame and the small tile
    optics, margin = microscope(44.5, 60, 40), 300.0
    edge_um = 15 * optics.wavelength_um / optics.aperture
    plate = rectangle(-5000.0, edge_um, 5000.0, 5000.0)
    sampling = Sampling(band_error=1e-12, margin=margin)
    found = render(one_layer(plate), optics, focus_um=0.0, sampling=sampling)[row]
    half_um = (optics.height_px - 1) / 2 * optics.um_per_px
    below_um = edge_um - half_um if row == 0 else edge_um + half_um

    def wave(f: float) -> float:
        share = diffraction(np.array([f / optics.cutoff_per_um]))[0]
        return float(share * np.sinc(f * optics.um_per_px) / f)

    top = optics.cutoff_per_um
    total = quad(wave, 1e-9, top, weight="sin", wvar=2 * np.pi * below_um)[0]
    expected, error = 0.5 - total / np.pi, margin_error(margin) + FAR_ERROR
    assert expected > 10 * error
    np.testing.assert_allclose(found, expected, rtol=0, atol=error)


def test_a_tile_shrinks_only_where_that_is_worth_it() -> None:
    large = _part(gear(), microscope(44.5, 640, 480), Sampling())
    assert large.far is not None
    near, wide = large.far.near.tile, large.far.wide.tile
    sizes = [tile.rows.count * tile.columns.count for tile in (near, wide)]
    assert sizes[0] < 0.6 * sizes[1]
    assert near.rows.seen == wide.rows.seen
    assert near.columns.seen == wide.columns.seen
    assert _part(disc(3.0), microscope(), Sampling()).far is None
    assert _part(gear(), microscope(44.5), Sampling(margin=NEAR)).far is None


def test_corrections_take_few_orders() -> None:
    optics = microscope(44.5, 640, 480)
    part = _part(gear(), optics, Sampling())
    assert part.far is not None
    unit = optics.wavelength_um / optics.aperture
    share = highest_per_um(NEAR * unit) / optics.cutoff_per_um
    assert share < 0.3
    for low in (part.far.near, part.far.wide):
        assert low.spectrum.values.size < 0.1 * part.far.wide.tile.rows.count * (
            part.far.wide.tile.columns.count
        )
