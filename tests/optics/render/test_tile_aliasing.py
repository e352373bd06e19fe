"""What a tile costs, predicted and measured against a tile eight times as wide."""

import numpy as np
import pytest

from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Window
from microplan.optics.render.tile_aliasing import MARGINS, margin_for, wrap_error
from tests.optics.shapes import disc, gear, microscope, one_layer, rectangle

WHOLE = 1e-12  # band error: nothing is cut off
CASES = {
    "disc": disc(12.0),
    "gear": gear(),
    "gear aside": place(gear(), 40.0, -30.0),
    "bar": rectangle(-90.0, -4.0, 70.0, 5.0),
    "finger": rectangle(-30.0, 5.0, 30.0, 20_800.0),
    "wide disc": disc(106.0, (2.0, 1.0)),
    "rim of a wide disc": disc(80.0, (-80.0, 7.0)),
    "half plane": rectangle(3.0, -1e4, 2e4, 1e4),
}


@pytest.mark.parametrize("outline", CASES.values(), ids=CASES)
@pytest.mark.parametrize("z_um", [0.0, 20.0])
@pytest.mark.parametrize("magnification", [6.9, 44.5])
def test_tiles_cost_what_is_predicted_at_most(
    outline: Outline, z_um: float, magnification: float
) -> None:
    optics = microscope(magnification, 64, 48)
    for margin in (10.0, 40.0):
        images = [
            render(
                one_layer(outline, z_um),
                optics,
                focus_um=0.0,
                sampling=Sampling(band_error=WHOLE, margin=m),
            )
            for m in (margin, 8 * margin)
        ]
        error = float(np.abs(images[0] - images[1]).max())
        bound = wrap_error(outline, optics, margin)
        # the wide tile has an error of its own
        assert error <= bound + wrap_error(outline, optics, 8 * margin)
        assert bound <= max(30 * error, 1e-5)  # and the bound says something


def test_what_is_far_away_costs_next_to_nothing() -> None:
    optics = microscope()
    for outline in (
        rectangle(-1e5, -1e5, 1e5, 1e5),
        disc(5.0, (1e4, 0.0)),
    ):
        # two sides 1e5 um away, or an area of 79 um2 1e4 um away, times .023
        assert 0 < wrap_error(outline, optics, 20.0) < 2e-6
    assert wrap_error(Outline(rings=()), optics, 20.0) == 0


def test_what_lies_beyond_the_margin_costs_its_tail() -> None:
    optics = microscope(6.9, 64, 48)
    part = disc(10.0, (60.0, 0.0))  # 15 um beyond the frame: 11 wavelengths / A
    images = [
        render(one_layer(part), optics, focus_um=0.0, sampling=Sampling(margin=m))
        for m in (5.0, 40.0)
    ]
    assert images[0].max() == 0
    # the bound takes all of the disc for as near as its nearest point: (25 / 15)**3
    assert images[1].max() <= wrap_error(part, optics, 5.0) < 4.7 * images[1].max()


def test_a_window_counts_instead_of_the_frame() -> None:
    optics = microscope()
    corner = Window(row=0, column=0, rows=8, columns=8)
    seen = wrap_error(disc(12.0), optics, 20.0)
    assert wrap_error(disc(12.0), optics, 20.0, corner) < seen


@pytest.mark.parametrize("error", [1e-2, 1e-3, 1e-4])
def test_the_margin_is_the_least_that_keeps_the_error(error: float) -> None:
    optics = microscope()
    margin = margin_for(gear(), optics, error)
    assert wrap_error(gear(), optics, margin) <= error
    place_in_list = int(np.flatnonzero(margin == MARGINS)[0])
    if place_in_list:
        below = float(MARGINS[place_in_list - 1])
        assert wrap_error(gear(), optics, below) > error


def test_the_last_margin_is_taken_where_none_will_do() -> None:
    assert margin_for(gear(), microscope(), 0.0) == MARGINS[-1]
