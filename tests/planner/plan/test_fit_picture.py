"""Picture of an overlap: what is dark, how much of it, and where."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.compiling.outline_shapes import chain, d_shape, hollow
from microplan.optics.outline.outline import Arc
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.assembly.fits.room import overlap_of
from microplan.planner.plan.fit_picture import (
    MARGIN,
    OVERLAP,
    SHAFT,
    SIDE_PX,
    draw_overlap,
)

POST = chain([Arc(center=(0, 0), radius_um=30.0, start_rad=0, sweep_rad=math.tau)])


def test_the_overlap_is_dark_and_as_large_as_it_is() -> None:
    shape = PegInHole(hole=hollow(d_shape(33.0, 20.0)), peg=POST)
    overlap = overlap_of(shape)
    assert overlap is not None
    drawn = draw_overlap(shape, overlap, "post in bore")[:SIDE_PX]
    um_per_px = 66.0 / (SIDE_PX * (1 - 2 * MARGIN))
    half = math.acos(20 / 30)
    segment = 30**2 * (half - math.sin(half) * math.cos(half))
    dark = (drawn == OVERLAP).sum() * um_per_px**2
    # lines and the label lie over some of it
    assert 0.8 * segment < dark < segment
    rows, columns = np.nonzero(drawn == OVERLAP)
    assert rows.mean() == pytest.approx(SIDE_PX / 2, abs=20)
    # lines are as dark where they are smoothed
    assert np.median(columns) > 1.2 * np.median(np.nonzero(drawn == SHAFT)[1])
