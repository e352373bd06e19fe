"""An outline's own frame does not depend on where the outline lies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.optics.outline.clip import to_edges
from microplan.optics.outline.outline import Outline, place
from microplan.optics.outline.own_frame import own_edges, own_frame
from tests.optics.shapes import disc, gear, rectangle


@pytest.mark.parametrize(
    "outline", [gear(), disc(22.0, (3.0, -4.0)), rectangle(-160.0, -10.0, 0.0, 20000.0)]
)
def test_outlines_that_only_moved_have_the_same_edges(outline: Outline) -> None:
    rng = np.random.default_rng(3)
    _, _, here = own_frame(outline)
    for _ in range(20):
        x, y = rng.uniform(-1e3, 1e3, 2)
        there = place(outline, x, y, rng.uniform(-math.pi, math.pi))
        assert own_frame(there)[2] == here


def test_edges_turned_and_shifted_back_are_the_outlines() -> None:
    outline = place(gear(), 31.0, -7.0, 2.0)
    (c, s), (x, y), own = own_frame(outline)
    found, wanted = own_edges(own).arcs, to_edges(outline).arcs
    u, v = found[:, 0], found[:, 1]
    middles = np.column_stack([x + c * u - s * v, y + s * u + c * v])
    np.testing.assert_allclose(middles, wanted[:, :2], rtol=0, atol=1e-5)
    starts = np.exp(1j * (found[:, 3] + math.atan2(s, c) - wanted[:, 3]))
    np.testing.assert_allclose(starts, 1.0, rtol=0, atol=1e-5)
