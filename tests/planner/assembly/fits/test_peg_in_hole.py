"""Slices that are kept, and the edges of polygons."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from benchmarks.compiling.outline_shapes import d_shape, hollow
from microplan.planner.assembly.fits import peg_in_hole
from microplan.planner.assembly.fits.peg_in_hole import PegInHole, Slices, edges_of


def area_um2(starts: np.ndarray, ends: np.ndarray) -> float:
    """Return the area that edges go round, holes the other way round."""
    return float((starts[:, 0] * ends[:, 1] - starts[:, 1] * ends[:, 0]).sum() / 2)


def test_edges_go_round_their_polygons() -> None:
    inner = [(2, 2), (4, 2), (4, 5), (2, 5)]
    ring = Polygon([(0, 0), (10, 0), (10, 10), (0, 10)], holes=[inner])
    polygons = [Polygon([(0, 0), (0, 3), (3, 0)]), ring, shapely.box(-1, -1, 0, 0)]
    edges = edges_of(polygons)
    assert edges.count == 3
    for index, polygon in enumerate(polygons):
        own = edges.owner == index
        found = area_um2(edges.starts_um[own], edges.ends_um[own])
        assert found == pytest.approx(polygon.area)


def test_no_polygons_have_no_edges() -> None:
    edges = edges_of([])
    assert (edges.count, len(edges.owner), len(edges.starts_um)) == (0, 0, 0)


def test_slices_that_were_forgotten_are_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shape = PegInHole(hole=hollow(d_shape(25.0, 16.0)), peg=d_shape(23.5, 14.5))
    monkeypatch.setattr(peg_in_hole, "KEPT_SLICES", 2)
    monkeypatch.setattr(peg_in_hole, "KEPT_SIZES", 1)
    slices = Slices(shape)
    wanted = [(turn, more, -more) for turn in (0.0, 0.01) for more in (0.0, 0.2, -0.1)]
    first = [slices.at(*each) for each in wanted]
    assert [slices.at(*each) for each in wanted] == first
    assert slices.at(*wanted[0]) is not first[0]
